// SPDX-License-Identifier: Apache-2.0
/** The room as a box: what it makes of the ambient light and of reflections beside the probe (docs/users/conventions.md, "Ambient light at a place"). */
import type { Room, Vec3 } from "./estimate.js";
import { MAX_ORDER, basisInto, orderOf } from "./sh.js";

/** Directions in which the light is looked up. */
const DIRECTIONS = 128;
/** A place beyond a wall, or closer to it, is taken to be at this share of the way to it. */
const WITHIN = 0.95;

/** A Fibonacci sphere: x, y, z of each. */
const SPHERE = new Float64Array(3 * DIRECTIONS);
for (let k = 0; k < DIRECTIONS; k++) {
  const y = 1 - (2 * (k + 0.5)) / DIRECTIONS, ring = Math.sqrt(1 - y * y), phi = Math.PI * (1 + Math.sqrt(5)) * (k + 0.5);
  SPHERE.set([ring * Math.cos(phi), y, ring * Math.sin(phi)], 3 * k);
}

/** Where the probe sees what is seen in each direction, and what that is: workspace of {@link movedSh}. */
const SEEN = new Float64Array(3 * DIRECTIONS);
const RED = new Float64Array(DIRECTIONS), GREEN = new Float64Array(DIRECTIONS), BLUE = new Float64Array(DIRECTIONS);

/** Of an order: Y_i of the directions, times 4π/n, coefficient by coefficient; and what the SH of the light in these directions are, by the SH of the light. */
interface Table {
  basis: Float64Array;
  seen: Float64Array;
}

const tables: (Table | undefined)[] = Array.from({ length: MAX_ORDER + 1 }, () => undefined);

function tableOf(order: number): Table {
  const known = tables[order];
  if (known) return known;
  const count = (order + 1) ** 2, one = new Float64Array(count), weight = (4 * Math.PI) / DIRECTIONS;
  const table = { basis: new Float64Array(count * DIRECTIONS), seen: new Float64Array(count * count) };
  for (let k = 0; k < DIRECTIONS; k++) {
    basisInto(order, SPHERE[3 * k]!, SPHERE[3 * k + 1]!, SPHERE[3 * k + 2]!, one);
    for (let i = 0; i < count; i++) {
      table.basis[i * DIRECTIONS + k] = weight * one[i]!;
      for (let j = 0; j < count; j++) table.seen[i * count + j]! += weight * one[i]! * one[j]!;
    }
  }
  return (tables[order] = table);
}

/** Row by row: turns the box's axes into the estimate's frame. */
function turnOf([x, y, z, w]: readonly [number, number, number, number]): number[] {
  return [
    1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y), 2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
    2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
  ];
}

/** The place in the box's axes, within the walls. */
function inside({ wallsM }: Room, turn: number[], [x, y, z]: Vec3): Vec3 {
  const along = (a: number): number => {
    const wayM = turn[a]! * x + turn[3 + a]! * y + turn[6 + a]! * z;
    return Math.max(-WITHIN * wallsM[2 * a]!, Math.min(WITHIN * wallsM[2 * a + 1]!, wayM));
  };
  return [along(0), along(1), along(2)];
}

/** How far it is along a ray from a place to the walls across one axis. */
function wayM(ray: number, placeM: number, lowM: number, highM: number): number {
  return ray === 0 ? Infinity : ((ray > 0 ? highM : -lowM) - placeM) / ray;
}

/**
 * Where the probe sees the points of the walls that a place sees: into `seen`, unit vectors, x, y, z of each. `towards`: where the place looks, of any
 * length above 0. The place is in metres from the probe; all axes are those of the room's frame.
 */
export function seenInto(room: Room, positionM: Vec3, towards: Float64Array, seen: Float64Array): void {
  const turn = turnOf(room.orientation), [px, py, pz] = inside(room, turn, positionM);
  const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = turn as [number, number, number, number, number, number, number, number, number];
  const [lowX, highX, lowY, highY, lowZ, highZ] = room.wallsM as [number, number, number, number, number, number];
  for (let at = 0; at < towards.length; at += 3) {
    const dx = towards[at]!, dy = towards[at + 1]!, dz = towards[at + 2]!;
    const bx = xx * dx + yx * dy + zx * dz, by = xy * dx + yy * dy + zy * dz, bz = xz * dx + yz * dy + zz * dz;
    const t = Math.min(wayM(bx, px, lowX, highX), wayM(by, py, lowY, highY), wayM(bz, pz, lowZ, highZ));
    const hx = px + t * bx, hy = py + t * by, hz = pz + t * bz, length = Math.sqrt(hx * hx + hy * hy + hz * hz);
    seen[at] = (xx * hx + xy * hy + xz * hz) / length;
    seen[at + 1] = (yx * hx + yy * hy + yz * hz) / length;
    seen[at + 2] = (zx * hx + zy * hy + zz * hz) / length;
  }
}

/** SH, r0 g0 b0 r1 …, of the ambient light at a place: metres from the probe, axes of the estimate's frame. */
export function movedSh(coefficients: readonly number[], room: Room, positionM: Vec3): number[] {
  const order = orderOf(coefficients), count = (order + 1) ** 2, { basis, seen } = tableOf(order);
  const from = Float64Array.from(coefficients), one = new Float64Array(count), there = new Array<number>(3 * count);
  seenInto(room, positionM, SPHERE, SEEN);
  for (let k = 0; k < DIRECTIONS; k++) {
    basisInto(order, SEEN[3 * k]!, SEEN[3 * k + 1]!, SEEN[3 * k + 2]!, one);
    let r = 0, g = 0, b = 0;
    for (let j = 0; j < count; j++) {
      const y = one[j]!;
      r += y * from[3 * j]!;
      g += y * from[3 * j + 1]!;
      b += y * from[3 * j + 2]!;
    }
    RED[k] = r;
    GREEN[k] = g;
    BLUE[k] = b;
  }
  for (let i = 0; i < count; i++) {
    let r = from[3 * i]!, g = from[3 * i + 1]!, b = from[3 * i + 2]!;
    for (let k = 0, at = i * DIRECTIONS; k < DIRECTIONS; k++, at++) {
      const y = basis[at]!;
      r += y * RED[k]!;
      g += y * GREEN[k]!;
      b += y * BLUE[k]!;
    }
    for (let j = 0, at = i * count; j < count; j++, at++) {
      const y = seen[at]!;
      r -= y * from[3 * j]!;
      g -= y * from[3 * j + 1]!;
      b -= y * from[3 * j + 2]!;
    }
    there[3 * i] = r;
    there[3 * i + 1] = g;
    there[3 * i + 2] = b;
  }
  return there;
}

/** The room as it is from a place. */
export function roomAt(room: Room, positionM: Vec3): Room {
  const placeM = inside(room, turnOf(room.orientation), positionM);
  return { ...room, wallsM: room.wallsM.map((wall, i) => wall + (i % 2 ? -1 : 1) * placeM[i >> 1]!) };
}
