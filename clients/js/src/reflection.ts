// SPDX-License-Identifier: Apache-2.0
/** Reflection maps: radiance on the six faces of a cube, in OpenGL's and WebXR's orientation, in the probe's axes. */

import type { Drawn } from "./estimate.js";
import type { Vec3 } from "./sh.js";

export interface ReflectionMap {
  /** Of the estimate that is the same light. */
  sequence: number;
  bootId: number;
  /** By the probe's clock. */
  captureTimeUnixMs: number;
  /** Number of the subscription that it answers. */
  subscription: number;
  /** AMBIENT: without the lights that the estimate lists, KEY is in it. TOTAL: with them. */
  kind: "AMBIENT" | "TOTAL";
  /** Texels along an edge. */
  size: number;
  /** RGB of face +X −X +Y −Y +Z −Z, row by row as WebGL uploads them; radiance in the units of the SH. */
  faces: Float32Array<ArrayBuffer>[];
  /** x, y, z, w: turns the probe frame, in which the map always is, into that of Estimate.orientation. */
  orientation: [number, number, number, number] | undefined;
  /** Error to expect of glossy things and mirrors, 1 sigma; undefined: the probe is older than this. */
  drawn?: Drawn | undefined;
}

/** Of each face: where its middle, its columns and its rows lead (OpenGL 4.6, table 8.19). */
export const FACE_AXES: readonly [Vec3, Vec3, Vec3][] = [
  [[1, 0, 0], [0, 0, -1], [0, -1, 0]], [[-1, 0, 0], [0, 0, 1], [0, -1, 0]],
  [[0, 1, 0], [1, 0, 0], [0, 0, 1]], [[0, -1, 0], [1, 0, 0], [0, 0, -1]],
  [[0, 0, 1], [1, 0, 0], [0, -1, 0]], [[0, 0, -1], [-1, 0, 0], [0, -1, 0]],
];

/** Unit vectors through the middles of the texels: face by face, row by row. */
export function texelDirections(size: number): Float32Array {
  const directions = new Float32Array(18 * size * size);
  FACE_AXES.forEach(([main, across, down], face) => {
    for (let i = 0; i < size * size; i++) {
      const s = (2 * (i % size) + 1) / size - 1, t = (2 * Math.floor(i / size) + 1) / size - 1, length = Math.hypot(1, s, t);
      for (let a = 0; a < 3; a++) directions[3 * (face * size * size + i) + a] = (main[a]! + s * across[a]! + t * down[a]!) / length;
    }
  });
  return directions;
}

/** Of the texels of one face, row by row, exact; the six faces sum to 4π. */
export function texelSolidAngles(size: number): Float32Array {
  const corner = (column: number, row: number): number => {
    const s = (2 * column) / size - 1, t = (2 * row) / size - 1;
    return Math.atan2(s * t, Math.hypot(s, t, 1));
  };
  return Float32Array.from({ length: size * size }, (_, i) => {
    const column = i % size, row = Math.floor(i / size);
    return corner(column + 1, row + 1) - corner(column, row + 1) - corner(column + 1, row) + corner(column, row);
  });
}

/** Six faces of RGB floats from RGB9E5 texels, little-endian (OpenGL 4.6, 8.5.2), times `scale`. */
export function decodeRgb9e5(texels: Uint8Array, size: number, scale: number): Float32Array<ArrayBuffer>[] {
  const view = new DataView(texels.buffer, texels.byteOffset, texels.byteLength);
  return FACE_AXES.map((_, face) => {
    const rgb = new Float32Array(3 * size * size);
    for (let i = 0; i < size * size; i++) {
      const bits = view.getUint32(4 * (face * size * size + i), true), unit = scale * 2 ** ((bits >>> 27) - 24);
      for (let c = 0; c < 3; c++) rgb[3 * i + c] = unit * ((bits >>> (9 * c)) & 511);
    }
    return rgb;
  });
}

/** Which texel lies along a direction of the probe's axes, of any length above 0: counted face by face, row by row. */
export function texelIndex(size: number, direction: Vec3): number {
  const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const along = FACE_AXES.map(([main]) => dot(main, direction)), face = along.indexOf(Math.max(...along));
  const [, across, down] = FACE_AXES[face]!;
  const index = (axis: Vec3): number => Math.min(size - 1, Math.max(0, Math.floor(((dot(axis, direction) / along[face]! + 1) / 2) * size)));
  return (face * size + index(down)) * size + index(across);
}

/** Radiance of the texel along a direction of the probe's axes, of any length above 0. */
export function reflected(map: ReflectionMap, direction: Vec3): [number, number, number] {
  const texel = texelIndex(map.size, direction), ofFace = map.size * map.size, face = map.faces[Math.floor(texel / ofFace)]!, at = 3 * (texel % ofFace);
  return [face[at]!, face[at + 1]!, face[at + 2]!];
}

/** The largest value of any texel and channel. */
export function largest(map: ReflectionMap): number {
  let most = 0;
  for (const face of map.faces) for (const value of face) most = Math.max(most, value);
  return most;
}
