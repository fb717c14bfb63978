// SPDX-License-Identifier: Apache-2.0
/** How bright the probe's light is in the page. A probe without calibration has units of its own, and a page shows 0…1. */

/** A white surface shows half of full brightness, in the mean over all normals. */
const WANTED = Math.PI / 2;
/** So far off, as a factor, the brightness of the room may be before the exposure follows. */
const FREE = 8;
/** Time constant of following, in seconds. */
const FOLLOW_S = 2;

/**
 * The factor is chosen by the first light of a boot of the probe, and then stays, so that a lamp that is switched on makes the page
 * brighter. Only when the room is {@link FREE} times brighter or darker than that, it follows slowly, as a camera does.
 */
export class Exposure {
  #gain: number | undefined;
  #bootId: number | undefined;
  #lastMs = 0;

  /** `fixed`: always this factor. */
  constructor(readonly fixed: number | undefined) {}

  /** The factor for an estimate of this mean irradiance, at a time of a clock in milliseconds. */
  gain(meanIrradiance: number, bootId: number, nowMs: number): number {
    if (this.fixed !== undefined) return this.fixed;
    const mean = Math.max(meanIrradiance, 1e-12), passedS = Math.max(0, nowMs - this.#lastMs) / 1000;
    this.#lastMs = nowMs;
    if (this.#gain === undefined || bootId !== this.#bootId) {
      this.#bootId = bootId;
      return (this.#gain = WANTED / mean);
    }
    const bounded = Math.min(FREE, Math.max(1 / FREE, (this.#gain * mean) / WANTED));
    const target = (bounded * WANTED) / mean; // the gain itself, within the bounds
    return (this.#gain *= (target / this.#gain) ** (1 - Math.exp(-passedS / FOLLOW_S)));
  }
}
