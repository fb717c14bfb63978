// SPDX-License-Identifier: Apache-2.0
/** Where lamps and the object are in a plan of the room: metres in the probe's axes, seen from above. No DOM in this file. */
import { estimateAt, reflectionMapAt } from "../src/index.js";
import type { Estimate, Light, ReflectionMap, Room, Vec3 } from "../src/index.js";

const DEG = Math.PI / 180;
/** What the plan shows from its middle to its border; a lamp further away is an arrow at the border. */
const HALF_WIDTHS_M = [1, 1.5, 2, 3, 5, 7, 10];
export const MOST_M = 10;
/** Share of the half width that lamps fill at most: the rest is for their labels. */
const FILLED = 0.85;

/** A lamp whose place is known. */
export interface Spot {
  light: Light;
  /** To the right of the probe. */
  xM: number;
  /** Behind the probe: forward is −Z. */
  zM: number;
  /** 1 sigma in the plan, along the line from the probe and across it. */
  alongM: number;
  acrossM: number;
}

/** Undefined: its distance is not known. */
export function spotOf(light: Light): Spot | undefined {
  if (light.distanceM === undefined) return undefined;
  const [x, y, z] = light.direction, level = Math.hypot(x, z);
  const awayM = light.distanceM * (light.distanceSigma ?? 0);
  const asideM = light.distanceM * (light.directionSigmaDeg ?? 0) * DEG;
  // The sigmas make an ellipsoid of revolution about the line of sight; this is its shadow on the floor.
  return { light, xM: light.distanceM * x, zM: light.distanceM * z, alongM: Math.hypot(level * awayM, y * asideM), acrossM: asideM };
}

/** The corners of the room in the plan, in turn: of its two axes that are more level than the third. */
export function cornersOf({ wallsM, orientation: [x, y, z, w] }: Room): [xM: number, zM: number][] {
  const axes: Vec3[] = [
    [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
    [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
  ];
  const [a, b] = [0, 1, 2].sort((i, j) => Math.abs(axes[i]![1]) - Math.abs(axes[j]![1])) as [number, number];
  const alongA = [-wallsM[2 * a]!, wallsM[2 * a + 1]!], alongB = [-wallsM[2 * b]!, wallsM[2 * b + 1]!];
  return ([[0, 0], [1, 0], [1, 1], [0, 1]] as const).map(([i, j]) => {
    const at = (k: number): number => alongA[i]! * axes[a]![k]! + alongB[j]! * axes[b]![k]!;
    return [at(0), at(2)];
  });
}

/** The light where the object stands. A TOTAL cannot be moved, because its lamps are in the SH: it stays as at the probe. */
export const lightThere = (estimate: Estimate, positionM: Vec3): Estimate => (estimate.sh.kind === "TOTAL" ? estimate : estimateAt(estimate, positionM));

/** What objects mirror where they stand. */
export class Mirrored {
  #of: ReflectionMap | undefined;
  #positionM: Vec3 | undefined;
  #hadRoom = false;
  #there: ReflectionMap | undefined;

  /** Of the light at the probe, where it knows the room; else the map itself. It is made anew for a new map or place: the room changes little between. */
  at(map: ReflectionMap, { room, frame }: Estimate, positionM: Vec3): ReflectionMap {
    const hasRoom = room !== undefined;
    if (!this.#there || map !== this.#of || positionM !== this.#positionM || hasRoom !== this.#hadRoom) {
      [this.#of, this.#positionM, this.#hadRoom] = [map, positionM, hasRoom];
      this.#there = room ? reflectionMapAt(map, room, positionM, frame) : map;
    }
    return this.#there;
  }
}

export const isPlaced = (estimate: Estimate | undefined): boolean => estimate?.lights.some((light) => light.distanceM !== undefined) ?? false;

/** The half width that shows all lamps and corners within {@link MOST_M}, and the object. It shrinks late: sizes of lamps' noise do not change it. */
export function halfWidthM(spots: Spot[], positionM: Vec3, nowM: number, corners: [xM: number, zM: number][] = []): number {
  const places = [...spots.map(({ xM, zM }) => Math.hypot(xM, zM)), ...corners.map(([xM, zM]) => Math.max(Math.abs(xM), Math.abs(zM)))];
  const needed = Math.max(...places.filter((away) => away <= FILLED * MOST_M), Math.abs(positionM[0]), Math.abs(positionM[2]), 0) / FILLED;
  const least = HALF_WIDTHS_M.find((half) => half >= needed) ?? MOST_M;
  return nowM >= needed && nowM <= 2 * least ? nowM : least;
}

const metres = (value: number): string => `${Math.abs(value).toFixed(2)} m`;

/** Where the object stands, in words. */
export function placeInWords([x, y, z]: Vec3): string {
  const parts = ([[x, "right of", "left of"], [z, "behind", "ahead of"], [y, "above", "below"]] as const)
    .filter(([value]) => Math.abs(value) >= 0.005).map(([value, more, less]) => `${metres(value)} ${value > 0 ? more : less}`);
  return `Object: ${parts.length > 0 ? `${parts.join(", ")} the probe` : "at the probe"}`;
}

/** What the light there lacks; "": all lamps have distances. */
export function missingInWords(estimate: Estimate): string {
  const without = estimate.lights.filter((light) => light.distanceM === undefined).length;
  const known = estimate.room ? "ambient light and what is mirrored change with the place, lamps light the object" : "the object is lit";
  if (!isPlaced(estimate)) return `No distance of a lamp is known, so ${known} as at the probe.`;
  return without === 0 ? "" : `Lamps without a known distance light the object as at the probe: ${without} of ${estimate.lights.length}.`;
}
