// SPDX-License-Identifier: Apache-2.0
/**
 * Reflection maps beside the probe (docs/users/conventions.md, "Reflection map at a place"; ReflectionMap.at is the same in Python): each texel
 * takes the light of the point of the walls that it looks at from there.
 */
import type { Estimate, Room, Vec3 } from "./estimate.js";
import { FACE_AXES, texelDirections, texelIndex, type ReflectionMap } from "./reflection.js";
import { seenInto } from "./room.js";

type Quaternion = [number, number, number, number];

/** Of a size: unit vectors through the texels; and of the faces with a rim of one texel, which texel each of them shows (corners: none, −1). */
interface Table {
  towards: Float64Array;
  wide: Int32Array;
}

const tables = new Map<number, Table>();

function tableOf(size: number): Table {
  const known = tables.get(size);
  if (known) return known;
  const wide = new Int32Array(6 * (size + 2) ** 2);
  const isRim = (k: number): boolean => k === 0 || k === size + 1;
  FACE_AXES.forEach(([main, across, down], face) => {
    for (let row = 0; row < size + 2; row++)
      for (let column = 0; column < size + 2; column++) {
        const s = (2 * column - 1) / size - 1, t = (2 * row - 1) / size - 1;
        const direction: Vec3 = [0, 1, 2].map((a) => main[a]! + s * across[a]! + t * down[a]!) as [number, number, number];
        wide[(face * (size + 2) + row) * (size + 2) + column] = isRim(row) && isRim(column) ? -1 : texelIndex(size, direction);
      }
  });
  const table = { towards: Float64Array.from(texelDirections(size)), wide };
  tables.set(size, table);
  return table;
}

/** RGB of the six faces, each with the texels of its neighbours around it; at the corners of the cube the mean of the three there. */
function widened({ faces, size }: ReflectionMap): Float32Array {
  const { wide } = tableOf(size), width = size + 2, rgb = new Float32Array(3 * wide.length), ofFace = size * size;
  for (let i = 0; i < wide.length; i++) {
    const from = wide[i]!;
    if (from < 0) continue;
    const face = faces[Math.floor(from / ofFace)]!, at = 3 * (from % ofFace);
    rgb[3 * i] = face[at]!;
    rgb[3 * i + 1] = face[at + 1]!;
    rgb[3 * i + 2] = face[at + 2]!;
  }
  for (let face = 0; face < 6; face++)
    for (const [row, down] of [[0, 1], [size + 1, -1]] as const)
      for (const [column, across] of [[0, 1], [size + 1, -1]] as const) {
        const at = (face * width + row) * width + column, beside = [at + across, at + down * width, at + down * width + across];
        for (let c = 0; c < 3; c++) rgb[3 * at + c] = beside.reduce((sum, one) => sum + rgb[3 * one + c]!, 0) / 3;
      }
  return rgb;
}

/** Faces of radiance along directions, x, y, z of each, linear between texels. */
function between(map: ReflectionMap, towards: Float64Array): Float32Array<ArrayBuffer>[] {
  const { size } = map, width = size + 2, wide = widened(map), ofFace = 3 * size * size, faces: Float32Array<ArrayBuffer>[] = [];
  for (let to = 0; to < 6; to++) {
    const rgb = new Float32Array(ofFace);
    for (let i = 0; i < ofFace; i += 3) {
      const x = towards[to * ofFace + i]!, y = towards[to * ofFace + i + 1]!, z = towards[to * ofFace + i + 2]!;
      const ax = Math.abs(x), ay = Math.abs(y), az = Math.abs(z);
      let face: number, s: number, t: number; // as FACE_AXES has them
      if (ax >= ay && ax >= az) [face, s, t] = [x > 0 ? 0 : 1, -z / x, -y / ax];
      else if (ay >= az) [face, s, t] = [y > 0 ? 2 : 3, x / ay, z / y];
      else [face, s, t] = [z > 0 ? 4 : 5, x / z, -y / az];
      const column = ((s + 1) / 2) * size + 0.5, row = ((t + 1) / 2) * size + 0.5;
      const left = Math.min(size, Math.floor(column)), above = Math.min(size, Math.floor(row)), u = column - left, v = row - above;
      const a = 3 * ((face * width + above) * width + left), b = a + 3 * width;
      const ofA = (1 - u) * (1 - v), ofRight = u * (1 - v), ofB = (1 - u) * v, ofLast = u * v;
      for (let c = 0; c < 3; c++) rgb[i + c] = ofA * wide[a + c]! + ofRight * wide[a + 3 + c]! + ofB * wide[b + c]! + ofLast * wide[b + 3 + c]!;
    }
    faces.push(rgb);
  }
  return faces;
}

/** First `b`, then `a`. */
const product = ([ax, ay, az, aw]: Quaternion, [bx, by, bz, bw]: Quaternion): Quaternion => [
  aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx, aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
];

/** A map in axes that are turned: `toMap` (x, y, z, w) turns the new axes into those of `map`. */
export function reflectionMapTurned(map: ReflectionMap, [qx, qy, qz, qw]: readonly [number, number, number, number]): ReflectionMap {
  const { towards } = tableOf(map.size), there = new Float64Array(towards.length);
  for (let i = 0; i < towards.length; i += 3) {
    const x = towards[i]!, y = towards[i + 1]!, z = towards[i + 2]!; // v + 2 q × (q × v + w v)
    const tx = 2 * (qy * z - qz * y), ty = 2 * (qz * x - qx * z), tz = 2 * (qx * y - qy * x);
    there[i] = x + qw * tx + qy * tz - qz * ty;
    there[i + 1] = y + qw * ty + qz * tx - qx * tz;
    there[i + 2] = z + qw * tz + qx * ty - qy * tx;
  }
  return { ...map, faces: between(map, there) };
}

/** The room and a place in the axes of the probe that `orientation` turns into theirs. */
function inProbe(room: Room, [px, py, pz]: Vec3, [x, y, z, w]: Quaternion): [Room, Vec3] {
  const back: Quaternion = [-x, -y, -z, w];
  const [qx, qy, qz] = product(product(back, [px, py, pz, 0]), [x, y, z, w]);
  return [{ ...room, orientation: product(back, room.orientation) }, [qx, qy, qz]];
}

/**
 * What shiny surfaces at a place mirror: the map as it would be seen from there, in the probe's axes, as `map` is. `room` and `frame` are those of an
 * estimate, best of the one with the same `sequence`; the place is x, y, z in metres from the probe, axes of that frame. Lamps in a map of TOTAL move as
 * if they were on the walls: take one of AMBIENT, and the lamps of `estimateAt`. RangeError: no place, or WORLD and a map without orientation.
 */
export function reflectionMapAt(map: ReflectionMap, room: Room, positionM: Vec3, frame: Estimate["frame"]): ReflectionMap {
  if (!positionM.every(Number.isFinite)) throw new RangeError(`reflection map: at ${positionM}: expected x, y, z in metres`);
  if (positionM.every((value) => value === 0)) return map;
  if (frame === "WORLD" && !map.orientation) throw new RangeError("reflection map: at: its orientation in the WORLD is not known");
  const [box, placeM] = frame === "WORLD" ? inProbe(room, positionM, map.orientation!) : [room, positionM];
  const { towards } = tableOf(map.size), seen = new Float64Array(towards.length);
  seenInto(box, placeM, towards, seen);
  return { ...map, faces: between(map, seen) };
}
