// SPDX-License-Identifier: Apache-2.0
/** What a probe says, typed. Units are in names; what is not known is undefined, never zero. */

import * as sh from "./sh.js";
import type { Vec3 } from "./sh.js";
import { EstimateFlag, LightFlag } from "./gen/lightprobe_pb.js";

export type { Vec3 };

/** Flags as the schema has them: of a lamp, and why an estimate is less than the probe at its best (0 is a healthy one). */
export { EstimateFlag, LightFlag };

/** Names of the bits that are set, of an estimate's flags or of a `LightFlag`; BIT_n for one that this version does not know. */
export function flagNames(flags: number, of: Record<number, string> = EstimateFlag): string[] {
  const names: string[] = [];
  for (let bit = 0; bit < 31; bit++)
    if ((flags >> bit) & 1) names.push(of[1 << bit] ?? `BIT_${bit}`);
  return names;
}

/** One lamp: a disc of this angular radius, far away. */
export interface Light {
  /** Stable while the lamp is tracked, within one boot of the probe. 0: KEY. */
  id: number;
  /** Unit vector towards the light; +X right, +Y up, −Z forward. */
  direction: Vec3;
  /** RGB on a surface that faces it; linear, Rec. 709 primaries. */
  irradiance: Vec3;
  angularRadiusDeg: number;
  directionSigmaDeg: number | undefined;
  /** 1 sigma, as a share of `irradiance`. */
  irradianceSigma: number | undefined;
  /** 1 sigma of red, green and blue, root mean square, over the luminance of `irradiance`: of lamps whose strength the ring found. */
  colourSigma: number | undefined;
  /**
   * Share, 0…1, of the light (luminance) that reaches a surface facing up, +Y of `Estimate.frame`: how dark its shadow on a table
   * is. undefined: no light reaches it, or an older probe.
   */
  shadowStrength: number | undefined;
  flags: number;
  /** From the probe, triangulated (`lightprobe field`); undefined: not known. */
  distanceM: number | undefined;
  /** 1 sigma of it, relative. */
  distanceSigma: number | undefined;
  /** It is at least so far away, at 3 sigma; undefined: `distanceM` is known, or nothing is. */
  nearestM: number | undefined;
  /** Area lights (EXTENDED): the ellipse with the same extent, from its centre along the longer and the shorter axis. */
  halfAngleDeg: [number, number] | undefined;
  /** Area lights: unit vector along the longer axis, across `direction`. */
  axis: Vec3 | undefined;
  /** Degree of linear polarization, 0…1; undefined without several angles of a polarizer. */
  dolp: number | undefined;
  /** 1 sigma of it. */
  dolpSigma: number | undefined;
  /** Angle of it, 0…180°: 0 horizontal, counter-clockwise as seen from inside. */
  aolpDeg: number | undefined;
  /** 1 sigma of it; 90: any angle is as likely. */
  aolpSigmaDeg: number | undefined;
  /**
   * Probability, 0…1, that it is the mirror image of another lamp: above 0.9 it is one (REFLECTION), below 0.1 none, in between
   * unsure. Without `dolp` place and strength alone tell.
   */
  reflection: number | undefined;
}

export interface SphericalHarmonics {
  /** AMBIENT: add the lights. TOTAL: they are in it. */
  kind: "AMBIENT" | "TOTAL";
  order: number;
  /** Of radiance: r0 g0 b0 r1 g1 b1 … */
  coefficients: number[];
}

/** Errors of what an app draws, as shares, each of its own measure; absent: not drawn, or not known. */
export interface Drawn {
  /** Light on matt surfaces, of its mean. */
  diffuse?: number;
  /** Light in the shadow of a ball on a table, of the open light. */
  shadows?: number;
  /** What a surface of 15° of blur shows, of white on a screen. */
  glossy?: number;
  /** What a surface of 1.5° of blur shows, of white on a screen. */
  mirrors?: number;
}

/** The room around the probe as a box: what the ambient light is like beside the probe. */
export interface Room {
  /** From the probe to the walls at −x +x −y +y −z +z of the box's own axes. */
  wallsM: number[];
  /** 1 sigma of each. */
  wallsSigmaM: number[];
  /** x, y, z, w: turns the box's axes into `Estimate.frame`. */
  orientation: [number, number, number, number];
  /** 1 sigma of the ambient light moved by it, for each metre from the probe; relative to the mean irradiance. */
  errorPerM: number;
}

export interface Estimate {
  sequence: number;
  bootId: number;
  /** By the probe's clock. */
  captureTimeUnixMs: number;
  sendDelayMs: number;
  /** Older than this after capture: fade to your default. 0: never. */
  ttlMs: number;
  flags: number;
  /** Strongest first. */
  lights: Light[];
  /** One directional light for what the listed lights leave; undefined: it was not asked for. */
  key: Light | undefined;
  sh: SphericalHarmonics;
  /** Left out by the chosen model, as a share of the mean irradiance. */
  predictedError: number | undefined;
  exposureUs: number | undefined;
  exposureCount: number;
  cdM2PerUnit: number | undefined;
  /** Relative, 1 sigma. */
  cdM2PerUnitSigma: number | undefined;
  /** 1 sigma of the scale of light against the first estimates, relative; undefined: exposures are known. */
  scaleSigma: number | undefined;
  wheelDeg: number | undefined;
  /** Number of the subscription that it answers. */
  subscription: number;
  /** WORLD: directions and SH are in the world of the app that sends poses. */
  frame: "PROBE" | "WORLD";
  /** x, y, z, w: turns the probe frame at capture time into one that does not move. */
  orientation: [number, number, number, number] | undefined;
  orientationSigmaDeg: number | undefined;
  /** x, y, z, metres: where the probe was at capture time, in the world of the app that sends poses. */
  positionM: [number, number, number] | undefined;
  /** undefined: nothing is known of the ambient light beside the probe. */
  room: Room | undefined;
  /** Error to expect of what the subscription draws, 1 sigma; undefined: it did not say what it draws. */
  drawn?: Drawn | undefined;
}

export interface Hello {
  protocolMajor: number;
  protocolMinor: number;
  software: string;
  bootId: number;
  source: string;
  name: string;
  insecureLan: boolean;
  maxShOrder: number;
  maxLights: number;
  smoothingTimeConstantMs: number;
  hasWheel: boolean;
  hasRing: boolean;
  preset: string;
  /** What tells it: none, visual, sim (its frames, recorded or simulated), client, sensor; "": older than protocol 1.3. */
  orientation: string;
  /** Texels along an edge; 0: it sends no reflection maps. */
  maxReflectionMapSize: number;
  /** What its cameras do to their pictures that changes the light in them, as far as they tell: "sharpness", "gamma", … */
  processing: string[];
}

/** The answer to a ping: times of our clock, and of the probe's. */
export interface Pong {
  pingTimeMs: number;
  receivedUnixMs: number;
  sentUnixMs: number;
}

export interface Health {
  uptimeMs: number;
  sourceState: string;
  framesReceived: number;
  framesDropped: number;
  framesRejected: number;
  estimates: number;
  estimatesPerS: number;
  latencyP50Us: number;
  latencyP99Us: number;
  clients: number;
  packetsSuperseded: number;
  cpuPercent: number;
  rssKib: number;
  preset: string;
  faults: { id: string; text: string }[];
}

/** The probe has refused a request. */
export interface Refusal {
  /** Negative errno. */
  code: number;
  text: string;
}

/** What is to be added to the SH: the lights and KEY; of a TOTAL nothing, it is in it. */
export function besideSh(estimate: Estimate | undefined): Light[] {
  if (!estimate || estimate.sh.kind === "TOTAL") return [];
  return estimate.key ? [...estimate.lights, estimate.key] : [...estimate.lights];
}

/** Irradiance on a surface with this normal: SH and lights together. */
export function irradiance(estimate: Estimate, normal: Vec3): [number, number, number] {
  const sum = sh.irradiance(estimate.sh.coefficients, normal);
  for (const light of besideSh(estimate)) {
    const cosine = Math.max(0, normal[0] * light.direction[0] + normal[1] * light.direction[1] + normal[2] * light.direction[2]);
    for (let c = 0; c < 3; c++) sum[c]! += cosine * light.irradiance[c]!;
  }
  return sum;
}

export const luminance = (rgb: ArrayLike<number>): number => 0.2126 * rgb[0]! + 0.7152 * rgb[1]! + 0.0722 * rgb[2]!;

/** Mean of the luminance of E(n) over all normals n: π L for uniform radiance L. */
export function meanIrradiance(estimate: Estimate): number {
  const ambient = Math.PI * 0.28209479177387814 * luminance(estimate.sh.coefficients);
  const lamps = besideSh(estimate).reduce((sum, light) => sum + luminance(light.irradiance), 0);
  return ambient + lamps / 4;
}

/** Mean radiance of a fallback before the first estimate: a white surface shows about half of full brightness. */
const FALLBACK_RADIANCE = 0.5;
/** How much brighter the upper side of a fallback is than its middle, as a share. */
const FALLBACK_FROM_ABOVE = 0.4;

/**
 * A neutral, soft light from above, for the time before the first and after the last estimate: as bright in the mean as `last`. It has
 * no lamps, because nobody knows where they are. Its bootId and sequence are 0.
 */
export function fallbackEstimate(last?: Estimate): Estimate {
  const mean = last ? Math.max(0, meanIrradiance(last) / Math.PI) : FALLBACK_RADIANCE;
  const flat = mean / 0.28209479177387814, up = (FALLBACK_FROM_ABOVE * mean) / 0.4886025119029199;
  return {
    sequence: 0, bootId: 0, captureTimeUnixMs: 0, sendDelayMs: 0, ttlMs: 0, flags: EstimateFlag.STALE, lights: [], key: undefined,
    sh: { kind: "AMBIENT", order: 1, coefficients: [flat, flat, flat, up, up, up, 0, 0, 0, 0, 0, 0] },
    predictedError: undefined, exposureUs: undefined, exposureCount: 0, cdM2PerUnit: last?.cdM2PerUnit, cdM2PerUnitSigma: undefined,
    scaleSigma: undefined, wheelDeg: undefined, subscription: 0, frame: "PROBE", orientation: undefined, orientationSigmaDeg: undefined, positionM: undefined,
    room: undefined,
  };
}
