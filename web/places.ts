// SPDX-License-Identifier: Apache-2.0
/** Where lamps and the object are in a plan of the room: metres in the probe's axes, seen from above. No DOM in this file. */
import { estimateAt } from "../src/index.js";
import type { Estimate, Light, Vec3 } from "../src/index.js";

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

/** The light where the object stands. A TOTAL cannot be moved, because its lamps are in the SH: it stays as at the probe. */
export const lightThere = (estimate: Estimate, positionM: Vec3): Estimate => (estimate.sh.kind === "TOTAL" ? estimate : estimateAt(estimate, positionM));

export const isPlaced = (estimate: Estimate | undefined): boolean => estimate?.lights.some((light) => light.distanceM !== undefined) ?? false;

/** The half width that shows all lamps within {@link MOST_M}, and the object. It shrinks late: sizes of lamps' noise do not change it. */
export function halfWidthM(spots: Spot[], positionM: Vec3, nowM: number): number {
  const lamps = spots.map(({ xM, zM }) => Math.hypot(xM, zM)).filter((away) => away <= FILLED * MOST_M);
  const needed = Math.max(...lamps, Math.abs(positionM[0]), Math.abs(positionM[2]), 0) / FILLED;
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
  if (!isPlaced(estimate)) return "No distance of a lamp is known, so the object is lit as at the probe.";
  return without === 0 ? "" : `Lamps without a known distance light the object as at the probe: ${without} of ${estimate.lights.length}.`;
}
