// SPDX-License-Identifier: Apache-2.0
/** Reflection maps in the axes of a scene, as bright as it shows them. */

import { largest, texelDirections, texelIndex, type ReflectionMap } from "./reflection.js";
import * as sh from "./sh.js";

export interface SceneMap {
  map: ReflectionMap;
  /** Another number for other texels. */
  key: number;
  /** Factor on its radiance. */
  gain: number;
}

/** A map that is made of SH has so many texels along an edge, and comes so often. */
const COARSE = 16;
export const COARSE_PERIOD_MS = 200;

/** No texel has changed by more than this share of the brightest: engines filter each new map, which takes them long. */
const UNCHANGED = 0.002;

/** It is the same light, within {@link UNCHANGED}. */
export function isAsBefore(before: SceneMap, map: ReflectionMap, gain: number): boolean {
  if (before.map.size !== map.size) return false;
  const most = UNCHANGED * gain * largest(map);
  for (let face = 0; face < 6; face++) {
    const now = map.faces[face]!, old = before.map.faces[face]!;
    for (let i = 0; i < now.length; i++) if (Math.abs(gain * now[i]! - before.gain * old[i]!) > most) return false;
  }
  return true;
}

/** Radiance of SH in each direction, nowhere below 0: what shiny things mirror where there is no map. */
export function coarseMap(coefficients: ArrayLike<number>, size = COARSE): ReflectionMap {
  const towards = texelDirections(size), texels = size * size;
  const faces = Array.from({ length: 6 }, (_, face) => {
    const rgb = new Float32Array(3 * texels);
    for (let i = 0; i < texels; i++) {
      const at = 3 * (face * texels + i), light = sh.radiance(coefficients, [towards[at]!, towards[at + 1]!, towards[at + 2]!]);
      rgb.set(light.map((value) => Math.max(0, value)), 3 * i);
    }
    return rgb;
  });
  return { sequence: 0, bootId: 0, captureTimeUnixMs: 0, subscription: 0, kind: "AMBIENT", size, faces, orientation: undefined };
}

const tables = new Map<string, Int32Array>();

/** Which texel of a map of this size lies along each texel's direction with one of x, y, z negated. */
function mirrorTable(size: number, axis: 0 | 2): Int32Array {
  const name = `${size} ${axis}`, known = tables.get(name);
  if (known) return known;
  const towards = texelDirections(size);
  const at = (i: number, a: number): number => (a === axis ? -1 : 1) * towards[3 * i + a]!;
  const table = Int32Array.from({ length: 6 * size * size }, (_, i) => texelIndex(size, [at(i, 0), at(i, 1), at(i, 2)]));
  tables.set(name, table);
  return table;
}

/** The map with x (0) or z (2) negated, for engines whose cube maps are in left-handed axes. */
export function mirroredMap(map: ReflectionMap, axis: 0 | 2): ReflectionMap {
  const ofFace = map.size * map.size, table = mirrorTable(map.size, axis);
  const faces = map.faces.map((_, face) => {
    const rgb = new Float32Array(3 * ofFace);
    for (let i = 0; i < ofFace; i++) {
      const from = table[face * ofFace + i]!, at = 3 * (from % ofFace);
      rgb.set(map.faces[Math.floor(from / ofFace)]!.subarray(at, at + 3), 3 * i);
    }
    return rgb;
  });
  return { ...map, faces };
}
