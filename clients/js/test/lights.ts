// SPDX-License-Identifier: Apache-2.0
/** Lamps and estimates as a probe sends them, with little in them. */
import type { Estimate, Light, Vec3 } from "../src/index.js";

export const lamp = (id: number, direction: Vec3, light: Vec3 = [1, 1, 1]): Light => ({
  id, direction, irradiance: light, angularRadiusDeg: 2, directionSigmaDeg: undefined, irradianceSigma: undefined, colourSigma: undefined, shadowStrength: undefined, flags: 0, distanceM: undefined, distanceSigma: undefined, nearestM: undefined,
  halfAngleDeg: undefined, axis: undefined,
  dolp: undefined, dolpSigma: undefined, aolpDeg: undefined, aolpSigmaDeg: undefined, reflection: undefined,
});

export const estimate = (lights: Light[], coefficients: number[] = Array(27).fill(0), bootId = 1): Estimate => ({
  sequence: 1, bootId, captureTimeUnixMs: 0, sendDelayMs: 0, ttlMs: 0, flags: 0, lights, key: undefined, subscription: 0, exposureCount: 1,
  sh: { kind: "AMBIENT", order: 2, coefficients }, predictedError: undefined, exposureUs: undefined, cdM2PerUnit: undefined, cdM2PerUnitSigma: undefined, scaleSigma: undefined, wheelDeg: undefined,
  frame: "PROBE", orientation: undefined, orientationSigmaDeg: undefined, positionM: undefined, room: undefined,
});
