// SPDX-License-Identifier: Apache-2.0
/** The light of a probe in the shape of WebXR's XRLightEstimate, so that code written for phones works. */

import { cubeTexels, fillCube } from "./cube.js";
import { besideSh, fallbackEstimate, luminance } from "./estimate.js";
import type { Estimate, Vec3 } from "./estimate.js";
import type { ReflectionMap } from "./reflection.js";
import * as sh from "./sh.js";

/**
 * A cube texture as XRWebGLBinding.getReflectionCubeMap() gives one: linear RGBA in half floats, filtered linearly, in
 * WebXR's orientation. Values are radiance in the units of the SH, at most 65504. It is yours: delete it. The context's own state
 * (textures that are bound, how data is unpacked) stays as it is.
 */
export function reflectionCubeMap(gl: WebGL2RenderingContext, map: ReflectionMap): WebGLTexture {
  const texture = gl.createTexture();
  fillCube(gl, texture, cubeTexels(map, "rgba16f"));
  return texture;
}

/** In browsers a DOMPointReadOnly, as WebXR has it; elsewhere there is none. */
export type Point = Pick<DOMPointReadOnly, "x" | "y" | "z" | "w">;

/** As https://www.w3.org/TR/webxr-lighting-estimation-1/#xrlightestimate-interface */
export interface LightEstimate {
  /** 27 floats r0 g0 b0 r1 …: radiance without the primary light. */
  readonly sphericalHarmonicsCoefficients: Float32Array;
  /** Towards the light; (0, 1, 0) when there is none. */
  readonly primaryLightDirection: Point;
  /** RGB; (0, 0, 0) when there is none. */
  readonly primaryLightIntensity: Point;
}

const point = ([x, y, z]: Vec3, w: number): Point =>
  (typeof DOMPointReadOnly === "undefined" ? { x, y, z, w } : new DOMPointReadOnly(x, y, z, w));

/** The strongest lamp is the primary light; the other lamps are put into the SH, so that nothing is lost or counted
 * twice. `undefined` (no estimate, or too old) gives the light of fallbackEstimate(). */
export function lightEstimate(known: Estimate | undefined): LightEstimate {
  const estimate = known ?? fallbackEstimate();
  const coefficients: number[] = Array.from({ length: 27 }, (_, i) => estimate.sh.coefficients[i] ?? 0);
  const lights = besideSh(estimate);
  lights.sort((a, b) => luminance(b.irradiance) - luminance(a.irradiance));
  const [primary, ...others] = lights;
  for (const light of others) sh.addLamp(coefficients, light.direction, light.irradiance);
  return {
    sphericalHarmonicsCoefficients: Float32Array.from(coefficients),
    primaryLightDirection: point(primary?.direction ?? [0, 1, 0], 0),
    primaryLightIntensity: point(primary?.irradiance ?? [0, 0, 0], 1),
  };
}
