// SPDX-License-Identifier: Apache-2.0
/** Reflection maps as rough metal shows them, for renderers that do not filter them by themselves. */

import { texelDirections, texelSolidAngles, type ReflectionMap } from "./reflection.js";

/** A square of texels counts as one where it is no wider than this share of the lobe there: within 1 % of all texels one by one. */
const WIDEST = 0.3;

/** So wide, in radians, a square may lie across the horizon, where the weight goes to 0. */
const STRADDLES = 0.1;

/** Squares of 2^level by 2^level texels, face by face, row by row. */
interface Level {
  size: number;
  /** Mean, RGB. */
  radiance: Float32Array;
  solidAngle: Float32Array;
  /** Unit vectors towards the squares' middles, and where their light comes from. */
  middle: Float32Array;
  source: Float32Array;
}

/**
 * Levels for roughness 0 … 1 in even steps, each half the size of the one before; the first is the map itself. Each
 * texel is the mean of the radiance with the weight D(h) · cos, D: GGX with α = roughness² (Karis: Real Shading in Unreal
 * Engine 4, 2013). Uniform light stays as it is. Texels that are far from the lobe, or narrow beside it, are taken together.
 */
export function ggxLevels(map: ReflectionMap, count: number): ReflectionMap[] {
  if (!Number.isInteger(count) || count < 2 || map.size >> (count - 1) < 1)
    throw new RangeError(`ggxLevels: ${count} levels of ${map.size} texels: expected 2 or more, the last of at least one texel`);
  const levels = pyramid(map);
  return Array.from({ length: count }, (_, level) => (level === 0 ? map : blurred(map, levels, map.size >> level, (level / (count - 1)) ** 2)));
}

/** From single texels to whole faces. */
function pyramid(map: ReflectionMap): Level[] {
  const { size } = map, texels = size * size, one = texelSolidAngles(size), middle = texelDirections(size);
  const radiance = new Float32Array(18 * texels), solidAngle = new Float32Array(6 * texels);
  map.faces.forEach((face, i) => {
    radiance.set(face, 3 * i * texels);
    solidAngle.set(one, i * texels);
  });
  const levels: Level[] = [{ size, radiance, solidAngle, middle, source: middle }];
  while (levels.at(-1)!.size > 1) levels.push(coarser(levels.at(-1)!));
  return levels;
}

function coarser(fine: Level): Level {
  const size = fine.size / 2, count = 6 * size * size;
  const out: Level = { size, radiance: new Float32Array(3 * count), solidAngle: new Float32Array(count), middle: new Float32Array(3 * count), source: new Float32Array(3 * count) };
  for (let i = 0; i < count; i++) {
    const middle = [0, 0, 0], source = [0, 0, 0], flux = [0, 0, 0];
    const first = firstChild(size, i);
    for (const child of [first, first + 1, first + 2 * size, first + 2 * size + 1]) {
      const weight = fine.solidAngle[child]!, bright = fine.radiance[3 * child]! + fine.radiance[3 * child + 1]! + fine.radiance[3 * child + 2]!;
      out.solidAngle[i]! += weight;
      for (let a = 0; a < 3; a++) {
        middle[a]! += weight * fine.middle[3 * child + a]!;
        source[a]! += weight * bright * fine.source[3 * child + a]!;
        flux[a]! += weight * fine.radiance[3 * child + a]!;
      }
    }
    const length = Math.hypot(...middle), reach = Math.hypot(...source);
    for (let a = 0; a < 3; a++) {
      out.radiance[3 * i + a] = flux[a]! / out.solidAngle[i]!;
      out.middle[3 * i + a] = middle[a]! / length;
      out.source[3 * i + a] = reach > 0 ? source[a]! / reach : middle[a]! / length;
    }
  }
  return out;
}

/** The upper left of the four squares of half the width in square `i` of a level of this size; rows of all faces, one after another. */
const firstChild = (size: number, i: number): number => 4 * size * Math.floor(i / size) + 2 * (i % size);

function blurred(map: ReflectionMap, levels: Level[], size: number, alpha: number): ReflectionMap {
  const normals = texelDirections(size), sum = new Float64Array(4);
  const faces = map.faces.map((_, face) => {
    const rgb = new Float32Array(3 * size * size);
    for (let at = 0; at < rgb.length; at += 3) {
      const from = 3 * face * size * size + at;
      sum.fill(0);
      for (let top = 0; top < 6; top++) gather(levels, levels.length - 1, top, normals[from]!, normals[from + 1]!, normals[from + 2]!, alpha, sum);
      for (let c = 0; c < 3; c++) rgb[at + c] = sum[c]! / sum[3]!;
    }
    return rgb;
  });
  return { ...map, size, faces };
}

/** Adds a square's light, times its weight, and the weight. With half vectors of light and normal, (n·h)² = (1 + n·l) / 2. */
function gather(levels: Level[], depth: number, i: number, x: number, y: number, z: number, alpha: number, sum: Float64Array): void {
  const { size, radiance, solidAngle, middle, source } = levels[depth]!, slope = (alpha * alpha - 1) / 2, at = 3 * i;
  const cosine = x * middle[at]! + y * middle[at + 1]! + z * middle[at + 2]!, lobe = 1 + slope * (1 + cosine), width = Math.PI / 2 / size;
  if (cosine < -width) return; // below the horizon, all of it
  if (depth > 0 && (width * width > WIDEST * WIDEST * lobe || (cosine < width && width > STRADDLES))) {
    const first = firstChild(size, i), below = first + 2 * size;
    gather(levels, depth - 1, first, x, y, z, alpha, sum);
    gather(levels, depth - 1, first + 1, x, y, z, alpha, sum);
    gather(levels, depth - 1, below, x, y, z, alpha, sum);
    gather(levels, depth - 1, below + 1, x, y, z, alpha, sum);
    return;
  }
  if (cosine > 0) sum[3]! += (cosine * solidAngle[i]!) / (lobe * lobe);
  const towards = x * source[at]! + y * source[at + 1]! + z * source[at + 2]!, bright = 1 + slope * (1 + towards);
  if (towards <= 0) return;
  const weight = (towards * solidAngle[i]!) / (bright * bright);
  sum[0]! += weight * radiance[at]!;
  sum[1]! += weight * radiance[at + 1]!;
  sum[2]! += weight * radiance[at + 2]!;
}
