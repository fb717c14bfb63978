// SPDX-License-Identifier: Apache-2.0
/** The light that a page is given, frame by frame: it fades, and has one main light. */

import { luminance } from "../estimate.js";
import { Fading as AllLamps, type SceneLight } from "../fading.js";
import * as sh from "../sh.js";
import type { Vec3 } from "../sh.js";

/** What an XRLightEstimate says. */
export interface Shown {
  /** 27 numbers, radiance without the main light. */
  coefficients: Float32Array<ArrayBuffer>;
  /** Towards the main light; (0, 1, 0) when there is none. */
  direction: Vec3;
  /** Irradiance of the main light on a surface that faces it. */
  irradiance: Vec3;
}

/** A lamp is the main light, with all that it has, when it is so much stronger than the next; with less of it when they are nearly equal. */
const CLEARLY = 1;

export class Fading {
  readonly #all = new AllLamps();

  /** Moves on towards `target`, to a time in milliseconds of any clock that is never set. The first target is shown at once. */
  step(target: SceneLight, nowMs: number): void {
    this.#all.step(target, nowMs / 1000);
  }

  /**
   * The strongest lamp is the main light. All others are in the SH. When another becomes the strongest, both are in the SH at that
   * moment, so that the main light does not leap from one to the other.
   */
  shown(): Shown {
    const lamps = this.#all.slots.filter(({ key }) => key !== undefined).sort((a, b) => luminance(b.irradiance) - luminance(a.irradiance));
    const [main, next] = lamps, coefficients = Array.from(this.#all.coefficients);
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
