// SPDX-License-Identifier: Apache-2.0
/**
 * Light beside the probe: lamps re-aimed and re-scaled, ambient light moved through the room (docs/users/conventions.md, "Light at a
 * place"; lightprobe.place is the same in Python). What is not known stays as the probe sees it, and says so: sigmas are undefined where nothing bounds the change.
 */
import { irradiance, luminance, type Estimate, type Light, type Vec3 } from "./estimate.js";
import { movedSh, roomAt } from "./room.js";

const DEG = Math.PI / 180;
/** Relative change of a lamp's light with the angle at which it leaves the lamp, 1 sigma for each radian. */
const EMISSION_CHANGE_PER_RAD = 0.6;

const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const scaled = (a: Vec3, by: number): Vec3 => [a[0] * by, a[1] * by, a[2] * by];
const minus = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const both = (a: number | undefined, b: number | undefined): number | undefined =>
  a === undefined || b === undefined ? undefined : Math.hypot(a, b);

/** A lamp as it is seen from a place: x, y, z in metres from the probe, axes of the estimate's frame. */
export function lightAt(light: Light, positionM: Vec3): Light {
  const awayM = Math.hypot(...positionM);
  if (awayM === 0) return light;
  if (light.distanceM === undefined) return farLight(light, awayM);
  const there = minus(scaled(light.direction, light.distanceM), positionM);
  const wayM = Math.hypot(...there);
  // A lamp is a ball; a place within it is taken to be on it.
  const ballM = light.distanceM * Math.sin(Math.min(light.angularRadiusDeg, 90) * DEG);
  const distanceM = Math.max(wayM, ballM, 1e-6);
  const direction = wayM > 0 ? scaled(there, 1 / wayM) : light.direction;
  const nearer = light.distanceM / distanceM;
  const along = dot(direction, light.direction), across = Math.sqrt(Math.max(0, 1 - along * along));
  const relative = light.distanceSigma;
  return {
    ...light, direction, distanceM,
    irradiance: scaled(light.irradiance, nearer * nearer),
    angularRadiusDeg: Math.asin(Math.min(1, ballM / distanceM)) / DEG,
    distanceSigma: relative === undefined ? undefined : relative * nearer * Math.abs(along),
    directionSigmaDeg: both(
      light.directionSigmaDeg === undefined ? undefined : light.directionSigmaDeg * nearer,
      relative === undefined ? undefined : (relative * nearer * across) / Math.SQRT2 / DEG,
    ),
    irradianceSigma: both(
      light.irradianceSigma,
      relative === undefined
        ? undefined
        : Math.hypot(2 * relative * Math.abs(1 - nearer * along), EMISSION_CHANGE_PER_RAD * Math.acos(Math.max(-1, Math.min(1, along)))),
    ),
    halfAngleDeg: light.halfAngleDeg && [halfAngle(light.halfAngleDeg[0], nearer), halfAngle(light.halfAngleDeg[1], nearer)],
    axis: light.axis && acrossOf(light.axis, direction),
  };
}

/**
 * The light at a place: x, y, z in metres from the probe, axes of `estimate.frame`. Only an estimate whose SH are AMBIENT can be moved:
 * a TOTAL has its lamps in the SH (RangeError). Where the room is known, the SH change with the place (best with `shOrder` 4), else
 * they stay as they are.
 */
export function estimateAt(estimate: Estimate, positionM: Vec3): Estimate {
  if (!positionM.every(Number.isFinite)) throw new RangeError(`estimate: at ${positionM}: expected x, y, z in metres`);
  const awayM = Math.hypot(...positionM);
  if (awayM === 0) return estimate;
  if (estimate.sh.kind === "TOTAL") throw new RangeError("estimate: at: lamps are in the SH: subscribe to AMBIENT");
  const lights = estimate.lights.map((light) => lightAt(light, positionM));
  const moved = { ...estimate, lights }, { room, sh } = estimate;
  if (room) {
    moved.sh = { ...sh, coefficients: movedSh(sh.coefficients, room, positionM) };
    moved.room = roomAt(room, positionM);
  }
  const up = luminance(irradiance(moved, [0, 1, 0]));
  moved.lights = lights
    .map((light) => ({ ...light, shadowStrength: shadowStrength(light, up) }))
    .sort((a, b) => luminance(b.irradiance) - luminance(a.irradiance));
  return moved;
}

/** A lamp without distance: its sigmas hold what the nearest distance, at 3 sigma, allows, or are undefined. */
function farLight(light: Light, awayM: number): Light {
  if (light.nearestM === undefined || light.nearestM <= 3 * awayM)
    return { ...light, directionSigmaDeg: undefined, irradianceSigma: undefined, shadowStrength: undefined };
  const share = awayM / light.nearestM / 3;
  return {
    ...light,
    nearestM: light.nearestM - awayM,
    directionSigmaDeg: both(light.directionSigmaDeg, share / DEG),
    irradianceSigma: both(light.irradianceSigma, 2 * share),
  };
}

const halfAngle = (deg: number, nearer: number): number => Math.atan(nearer * Math.tan(Math.min(deg, 89) * DEG)) / DEG;

/** What of an axis lies across the direction, as a unit vector. */
function acrossOf(axis: Vec3, direction: Vec3): Vec3 {
  const rest = minus(axis, scaled(direction, dot(axis, direction)));
  const length = Math.hypot(...rest);
  return length > 1e-6 ? scaled(rest, 1 / length) : axis;
}

/** Its share of the light on a surface that faces up; undefined where that is not known. */
function shadowStrength(light: Light, up: number): number | undefined {
  if (light.shadowStrength === undefined || up <= 0) return undefined;
  return Math.min(1, (Math.max(0, light.direction[1]) * luminance(light.irradiance)) / up);
}
