// SPDX-License-Identifier: Apache-2.0
/** The light that a page is given, frame by frame: it goes over to each new estimate without a jump, and has one main light. */

import { luminance } from "../estimate.js";
import * as sh from "../sh.js";
import type { Vec3 } from "../sh.js";

export interface Lamp {
  /** The same as long as it is the same lamp. */
  key: string;
  /** Unit vector towards it. */
  direction: Vec3;
  irradiance: Vec3;
}

/** Lamps, and SH of radiance of what is left (27 numbers, orthonormal, positive), in the axes of the page. */
export interface SceneLight {
  coefficients: ArrayLike<number>;
  lamps: readonly Lamp[];
}

/** What an XRLightEstimate says. */
export interface Shown {
  /** 27 numbers, radiance without the main light. */
  coefficients: Float32Array<ArrayBuffer>;
  /** Towards the main light; (0, 1, 0) when there is none. */
  direction: Vec3;
  /** Irradiance of the main light on a surface that faces it. */
  irradiance: Vec3;
}

/** Time constant of going over, in milliseconds. */
const FADE_MS = 150;
/** After a pause one step is not longer than this, unless the page always takes so long. */
const MOST_STEP_MS = 100;
/** Lamps below this share of the strongest have gone. */
const GONE = 1e-4;
/** A lamp is the main light, with all that it has, when it is so much stronger than the next; with less of it when they are nearly equal. */
const CLEARLY = 1;
/** Cosine of the angle within which a lamp with another key is the same lamp: after a new boot of the probe, all have other keys. */
const SAME_PLACE = Math.cos((8 * Math.PI) / 180);

interface Moving {
  direction: [number, number, number];
  irradiance: [number, number, number];
}

export class Fading {
  readonly #coefficients = new Float64Array(27);
  readonly #lamps = new Map<string, Moving>();
  #lastMs: number | undefined;
  #passedMs = 0;

  /** Moves on towards `target`, to a time in milliseconds of any clock that is never set. The first target is shown at once. */
  step(target: SceneLight, nowMs: number): void {
    const share = this.#share(nowMs);
    if (share === 0) return;
    for (let i = 0; i < 27; i++) this.#coefficients[i]! += share * ((target.coefficients[i] ?? 0) - this.#coefficients[i]!);
    const wanted = new Map(target.lamps.map((lamp) => [lamp.key, lamp]));
    for (const lamp of target.lamps) if (!this.#lamps.has(lamp.key)) this.#lamps.set(lamp.key, this.#takenOver(lamp, wanted) ?? { direction: [...lamp.direction], irradiance: [0, 0, 0] });
    for (const [key, lamp] of this.#lamps) move(lamp, wanted.get(key), share);
    this.#forget(wanted);
  }

  /** A lamp at this place that is no longer wanted by its old key. */
  #takenOver({ direction }: Lamp, wanted: ReadonlyMap<string, unknown>): Moving | undefined {
    for (const [key, lamp] of this.#lamps) {
      if (wanted.has(key) || lamp.direction.reduce((sum, value, a) => sum + value * direction[a]!, 0) < SAME_PLACE) continue;
      this.#lamps.delete(key);
      return lamp;
    }
    return undefined;
  }

  #share(nowMs: number): number {
    if (this.#lastMs === undefined) {
      this.#lastMs = nowMs;
      return 1;
    }
    const passedMs = nowMs - this.#lastMs;
    if (!(passedMs >= 1)) return 0; // asked twice within a frame
    const stepMs = Math.min(passedMs, Math.max(MOST_STEP_MS, this.#passedMs));
    this.#lastMs = nowMs;
    this.#passedMs = passedMs;
    return 1 - Math.exp(-stepMs / FADE_MS);
  }

  #forget(wanted: ReadonlyMap<string, unknown>): void {
    const most = Math.max(...[...this.#lamps.values()].map((lamp) => luminance(lamp.irradiance)), 0);
    for (const [key, { irradiance }] of this.#lamps) if (!wanted.has(key) && luminance(irradiance) <= GONE * most) this.#lamps.delete(key);
    if (wanted.size === 0 && this.#lamps.size === 1) this.#forgetLast();
  }

  /** The last lamp has none beside it to be compared with: the light of the SH is. */
  #forgetLast(): void {
    const [[key, { irradiance }]] = this.#lamps as unknown as [[string, Moving]];
    if (luminance(irradiance) <= GONE * Math.abs(luminance(this.#coefficients.subarray(0, 3)))) this.#lamps.delete(key);
  }

  /**
   * The strongest lamp is the main light. All others are in the SH. When another becomes the strongest, both are in the SH at that
   * moment, so that the main light does not leap from one to the other.
   */
  shown(): Shown {
    const lamps = [...this.#lamps.values()].sort((a, b) => luminance(b.irradiance) - luminance(a.irradiance));
    const [main, next] = lamps, coefficients = Array.from(this.#coefficients);
    const share = main ? mainShare(luminance(main.irradiance), next ? luminance(next.irradiance) : 0) : 0;
    lamps.forEach(({ direction, irradiance }, i) => {
      const rest = i === 0 ? 1 - share : 1;
      if (rest > 0) sh.addLamp(coefficients, direction, scaled(irradiance, rest));
    });
    return {
      coefficients: Float32Array.from(coefficients),
      direction: main ? [...main.direction] : [0, 1, 0],
      irradiance: main ? scaled(main.irradiance, share) : [0, 0, 0],
    };
  }
}

const scaled = ([r, g, b]: Vec3, by: number): Vec3 => [by * r, by * g, by * b];

/** How much of the strongest lamp is given as the main light: none where the next is as strong. */
function mainShare(first: number, second: number): number {
  if (!(second > 0)) return 1;
  const t = Math.min(1, Math.max(0, (first / second - 1) / CLEARLY));
  return t * t * (3 - 2 * t);
}

/** Moves a lamp towards what is wanted of it; undefined: towards darkness, where it is. */
function move(lamp: Moving, wanted: Lamp | undefined, share: number): void {
  for (let c = 0; c < 3; c++) lamp.irradiance[c]! += share * ((wanted?.irradiance[c] ?? 0) - lamp.irradiance[c]!);
  if (!wanted) return;
  const between = lamp.direction.map((value, a) => value + share * (wanted.direction[a]! - value)), length = Math.hypot(...between);
  const direction = length > 1e-3 ? between.map((value) => value / length) : wanted.direction; // opposite: no way between
  for (let a = 0; a < 3; a++) lamp.direction[a] = direction[a]!;
}
