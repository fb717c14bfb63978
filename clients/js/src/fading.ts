// SPDX-License-Identifier: Apache-2.0
/** Light that goes over to each new estimate without a jump. Every engine's component and lightprobe-webxr.js use it. */

import { besideSh, luminance, LightFlag, type Estimate } from "./estimate.js";
import * as sh from "./sh.js";
import type { Vec3 } from "./sh.js";
import { inverse, turned, type Quaternion } from "./turn.js";

export interface Lamp {
  /** The same as long as it is the same lamp. */
  key: string;
  /** Unit vector towards it. */
  direction: Vec3;
  /** RGB on a surface that faces it, linear. */
  irradiance: Vec3;
  angularRadiusDeg: number;
  /** The mirror image of another lamp: it casts no shadow. */
  isReflection: boolean;
}

/** Lamps, and SH of radiance of what is left (27 numbers, orthonormal, positive), in the axes of the scene. */
export interface SceneLight {
  coefficients: ArrayLike<number>;
  lamps: readonly Lamp[];
}

/** An estimate in axes into which `turn` turns its own; all light times `gain`. */
export function sceneLight(estimate: Estimate, turn: Quaternion, gain: number): SceneLight {
  const back = inverse(turn);
  return {
    coefficients: sh.rotate(estimate.sh.coefficients, (d) => turned(back, d)).map((value) => gain * value),
    lamps: besideSh(estimate).map(({ id, direction, irradiance: [r, g, b], angularRadiusDeg, flags }) => ({
      key: `${estimate.bootId}/${id}`, direction: turned(turn, direction), irradiance: [gain * r, gain * g, gain * b], angularRadiusDeg,
      isReflection: (flags & LightFlag.REFLECTION) !== 0,
    })),
  };
}

/** A place for one lamp. An engine has one directional light for each. */
export interface Slot {
  /** Of the lamp that it shows; undefined: free, and dark. */
  key: string | undefined;
  /** Unit vector towards the lamp, in the scene. */
  direction: [number, number, number];
  irradiance: [number, number, number];
  angularRadiusDeg: number;
  isReflection: boolean;
}

/** Time constant of going over, in seconds. */
export const FADE_S = 0.15;
/** After a pause of the page one step is not longer than this, unless the page always takes so long. */
const MOST_STEP_S = 0.1;
/** Asked again sooner than this, in seconds: within one frame. */
const SAME_FRAME_S = 1e-3;
/** Lamps below this share of the strongest have gone. */
const GONE = 1e-4;
/** Cosine of the angle within which a lamp with another key is the same lamp: after a new boot of the probe, all have other keys. */
const SAME_PLACE = Math.cos((8 * Math.PI) / 180);

type Wanted = ReadonlyMap<string, Lamp>;

export class Fading {
  /** 27 numbers: SH of radiance, as shown now. */
  readonly coefficients = new Float64Array(27);
  /** A lamp keeps its slot while it lasts. Slots are made as they are needed. */
  readonly slots: Slot[] = [];
  readonly #most: number;
  readonly #fadeS: number;
  #isNew = true;
  #lastS: number | undefined;
  #passedS = 0;

  /** `most` lamps at once; `fadeS`: time constant in seconds. */
  constructor(most = Infinity, fadeS = FADE_S) {
    this.#most = most;
    this.#fadeS = fadeS;
  }

  /** Moves on towards `target`, to a time in seconds of any clock that is never set. The first target is shown at once. */
  step(target: SceneLight, nowS: number): void {
    const share = this.#share(nowS);
    if (share > 0) this.#move(target, share);
  }

  /** Shows `target` at once. */
  set(target: SceneLight): void {
    this.#move(target, 1);
    this.#lastS = undefined;
  }

  #share(nowS: number): number {
    const passedS = this.#lastS === undefined ? 0 : nowS - this.#lastS;
    if (this.#lastS === undefined || passedS >= SAME_FRAME_S || passedS < 0) this.#lastS = nowS; // below 0: another clock
    if (this.#isNew) return 1;
    if (!(passedS >= SAME_FRAME_S)) return 0;
    const stepS = Math.min(passedS, Math.max(MOST_STEP_S, this.#passedS));
    this.#passedS = passedS;
    return 1 - Math.exp(-stepS / this.#fadeS);
  }

  #move({ coefficients, lamps }: SceneLight, share: number): void {
    this.#isNew = false;
    for (let i = 0; i < 27; i++) this.coefficients[i]! += share * ((coefficients[i] ?? 0) - this.coefficients[i]!);
    const wanted: Wanted = new Map(lamps.slice(0, this.#most).map((lamp) => [lamp.key, lamp]));
    for (const lamp of wanted.values()) if (!this.slots.some(({ key }) => key === lamp.key)) this.#place(lamp, wanted);
    for (const slot of this.slots) move(slot, slot.key === undefined ? undefined : wanted.get(slot.key), share);
    this.#free(wanted);
  }

  /** Gives a new lamp a slot: that of the same lamp under another key as it is, or one where it begins in the dark. */
  #place({ key, direction, angularRadiusDeg, isReflection }: Lamp, wanted: Wanted): void {
    const leaving = this.slots.filter((slot) => slot.key !== undefined && !wanted.has(slot.key));
    const same = leaving.find((slot) => slot.direction.reduce((sum, value, a) => sum + value * direction[a]!, 0) >= SAME_PLACE);
    if (same) same.key = key;
    else Object.assign(this.#freeSlot(leaving), { key, direction: [...direction], irradiance: [0, 0, 0], angularRadiusDeg, isReflection });
  }

  /** A free slot, a new one, or of those whose lamp has gone and still fades the darkest. */
  #freeSlot(leaving: Slot[]): Slot {
    const free = this.slots.find(({ key }) => key === undefined);
    if (free) return free;
    if (this.slots.length >= this.#most) return leaving.reduce((least, one) => (luminance(one.irradiance) < luminance(least.irradiance) ? one : least));
    const slot: Slot = { key: undefined, direction: [0, 1, 0], irradiance: [0, 0, 0], angularRadiusDeg: 1, isReflection: false };
    this.slots.push(slot);
    return slot;
  }

  /** Frees the slots of lamps that are no longer wanted and no longer seen. */
  #free(wanted: Wanted): void {
    const lit = this.slots.filter(({ key }) => key !== undefined);
    // The last lamp has none beside it to be compared with: the light of the SH is.
    const most = wanted.size === 0 && lit.length === 1 ? Math.abs(luminance(this.coefficients)) : Math.max(0, ...lit.map(({ irradiance }) => luminance(irradiance)));
    for (const slot of lit)
      if (!wanted.has(slot.key!) && luminance(slot.irradiance) <= GONE * most) Object.assign(slot, { key: undefined, irradiance: [0, 0, 0] });
  }
}

/** Moves a slot towards what is wanted of its lamp; undefined: towards darkness, where it is. */
function move(slot: Slot, wanted: Lamp | undefined, share: number): void {
  for (let c = 0; c < 3; c++) slot.irradiance[c]! += share * ((wanted?.irradiance[c] ?? 0) - slot.irradiance[c]!);
  if (!wanted) return;
  const between = slot.direction.map((value, a) => value + share * (wanted.direction[a]! - value)), length = Math.hypot(...between);
  const direction = length > 1e-3 ? between.map((value) => value / length) : wanted.direction; // opposite: no way between
  for (let a = 0; a < 3; a++) slot.direction[a] = direction[a]!;
  slot.angularRadiusDeg += share * (wanted.angularRadiusDeg - slot.angularRadiusDeg);
  slot.isReflection = wanted.isReflection;
}
