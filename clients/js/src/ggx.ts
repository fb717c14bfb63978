// SPDX-License-Identifier: Apache-2.0
/** Reflection maps as rough metal shows them, for renderers that do not filter them by themselves. */

import { texelDirections, texelSolidAngles, type ReflectionMap } from "./reflection.js";

/**
 * Levels for roughness 0 … 1 in even steps, each half the size of the one before; the first is the map itself. Each
 * texel is the mean of the radiance with the weight D(h) · cos, D: GGX with α = roughness² (Karis: Real Shading in Unreal
 * Engine 4, 2013). Uniform light stays as it is. A map of 64 texels takes 190 million steps for three levels: use 32, or
 * a worker.
 */
export function ggxLevels(map: ReflectionMap, count: number): ReflectionMap[] {
  if (!Number.isInteger(count) || count < 2 || map.size >> (count - 1) < 1)
    throw new RangeError(`ggxLevels: ${count} levels of ${map.size} texels: expected 2 or more, the last of at least one texel`);
  return Array.from({ length: count }, (_, level) => (level === 0 ? map : blurred(map, map.size >> level, (level / (count - 1)) ** 2)));
}

function blurred(map: ReflectionMap, size: number, alpha: number): ReflectionMap {
  const towards = texelDirections(map.size), solidAngles = texelSolidAngles(map.size), normals = texelDirections(size);
  const texels = map.size * map.size, slope = (alpha * alpha - 1) / 2;
  const faces = map.faces.map((_, face) => {
    const rgb = new Float32Array(3 * size * size);
    for (let at = 0; at < rgb.length; at += 3) {
      const from = 3 * face * size * size + at, x = normals[from]!, y = normals[from + 1]!, z = normals[from + 2]!;
      let red = 0, green = 0, blue = 0, weights = 0;
      map.faces.forEach((radiance, other) => {
        for (let i = 0, d = 3 * other * texels; i < texels; i++, d += 3) {
          const cosine = x * towards[d]! + y * towards[d + 1]! + z * towards[d + 2]!;
          if (cosine <= 0) continue;
          const lobe = 1 + slope * (1 + cosine); // with half vectors of light and normal, (n·h)² = (1 + n·l) / 2
          const weight = (cosine * solidAngles[i]!) / (lobe * lobe);
          red += weight * radiance[3 * i]!;
          green += weight * radiance[3 * i + 1]!;
          blue += weight * radiance[3 * i + 2]!;
          weights += weight;
        }
      });
      rgb.set([red / weights, green / weights, blue / weights], at);
    }
    return rgb;
  });
  return { ...map, size, faces };
}
