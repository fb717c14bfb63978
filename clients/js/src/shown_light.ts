// SPDX-License-Identifier: Apache-2.0
/**
 * What every engine's component shows of a probe's light: faded, as strong as asked, and there when the probe is not. The engines'
 * files (three.ts, babylon.ts, playcanvas.ts) turn it into their own lights.
 */

import { fallbackEstimate, meanIrradiance, type Estimate, type Vec3 } from "./estimate.js";
import { Exposure } from "./exposure.js";
import { FADE_S, Fading, sceneLight, type SceneLight, type Slot } from "./fading.js";
import { estimateAt } from "./place.js";
import type { ReflectionMap } from "./reflection.js";
import { reflectionMapAt, reflectionMapTurned } from "./reflection_place.js";
import { coarseMap } from "./scene_map.js";
import * as sh from "./sh.js";
import { fromYaw, inverse, SAME, turned, type Quaternion } from "./turn.js";

export interface LightOptions {
  /** Lamps at once, default 4. Their number is fixed, because engines compile their shaders for it. */
  lamps?: number;
  /** Time constant of changes, in seconds. */
  fadeS?: number;
  /** What to show before the first and after the last estimate, given the last; default: fallbackEstimate. */
  fallback?: (last: Estimate | undefined) => Estimate;
  /** Factor on all light, 0 or more; default 1. */
  strength?: number;
  /** 0…1: how much of the light is replaced by a soft grey light from above (fallbackEstimate) of the same mean irradiance; default 0. */
  neutral?: number;
  /** Factor from the probe's units to the scene's; "auto": a white surface shows about half of full brightness (exposure.ts). */
  exposure?: number | "auto";
  /** By how many degrees the probe's −Z is turned to the left of the scene's −Z. */
  yawDeg?: number;
  /** Where the light is to be right: x, y, z in metres from the probe, axes of the scene. Lamps with a distance, and ambient light in a known room, change with it. */
  at?: Vec3 | undefined;
}

/** The value, if it is within bounds; else a RangeError that names it. */
const bounded = (name: string, value: number, least: number, most = Infinity): number => {
  if (value >= least && value <= most) return value;
  throw new RangeError(`${name}: ${value}: expected a number, ${least}…${most}`);
};

export class ShownLight {
  /** Turns the probe's axes into those of the scene. */
  turn: Quaternion;
  readonly #options: Required<Pick<LightOptions, "lamps" | "fadeS" | "fallback">>;
  readonly #fading: Fading;
  #exposure: Exposure;
  #strength = 1;
  #neutral = 0;
  #placeM: Vec3 | undefined;
  #gain = 1;
  #isLit = false;
  #last: Estimate | undefined;
  #fallback: Estimate | undefined;
  #moved: { from: Estimate; placeM: Vec3; there: Estimate } | undefined;

  /** `exposure`: where the options have none. RangeError: a strength or a neutral share that is none. */
  constructor(options: LightOptions, exposure: number | "auto" = 1) {
    const { lamps = 4, fadeS = FADE_S, fallback = fallbackEstimate } = options;
    this.#options = { lamps, fadeS, fallback };
    this.#fading = new Fading(lamps, fadeS);
    this.turn = fromYaw(options.yawDeg ?? 0);
    this.#exposure = exposureOf(options.exposure ?? exposure);
    this.strength = options.strength ?? 1;
    this.neutral = options.neutral ?? 0;
    this.at(options.at);
  }

  get lamps(): number {
    return this.#options.lamps;
  }

  /** Factor on all light, from the next frame on. */
  get strength(): number {
    return this.#strength;
  }

  set strength(value: number) {
    this.#strength = bounded("strength", value, 0);
  }

  /** 0…1: share of the grey light in its place, from the next frame on. */
  get neutral(): number {
    return this.#neutral;
  }

  set neutral(value: number) {
    this.#neutral = bounded("neutral", value, 0, 1);
  }

  /** As the option of this name; it begins anew with the next estimate. */
  set exposure(value: number | "auto") {
    this.#exposure = exposureOf(value);
  }

  /** From now on show the light of a place: metres from the probe, axes of the scene; undefined: where the probe is. RangeError: no place. */
  at(positionM: Vec3 | undefined): void {
    if (positionM && !positionM.every(Number.isFinite)) throw new RangeError(`at: ${positionM}: expected x, y, z in metres`);
    this.#placeM = positionM && positionM.some((value) => value !== 0) ? [...positionM] : undefined;
  }

  /** There is an estimate; false: the fallback is shown, or faded to. */
  get isLit(): boolean {
    return this.#isLit;
  }

  /** Factor on the probe's units: exposure times strength. */
  get gain(): number {
    return this.#gain * this.#strength;
  }

  /** SH of radiance of what is shown now, without the lamps: 27 numbers, axes of the scene. */
  get coefficients(): Float64Array {
    return this.#fading.coefficients;
  }

  /** The lamps as they are shown now, at most `lamps`; index by index the same lamp, while it lasts. */
  get slots(): readonly Slot[] {
    return this.#fading.slots;
  }

  /** Move on towards an estimate (undefined: the fallback); `timeS` of any clock that is never set. True: isLit has changed. */
  update(known: Estimate | undefined, timeS: number): boolean {
    return this.#show(known, (target) => this.#fading.step(target, timeS));
  }

  /** Show an estimate at once; undefined: the fallback. True: isLit has changed. */
  set(known: Estimate | undefined): boolean {
    return this.#show(known, (target) => this.#fading.set(target));
  }

  /** Irradiance of what is shown now on a surface with this normal, in the axes of the scene. */
  irradiance(normal: Vec3): [number, number, number] {
    const sum = sh.irradiance(this.coefficients, normal);
    for (const { direction, irradiance } of this.slots) {
      const cosine = Math.max(0, direction[0] * normal[0] + direction[1] * normal[1] + direction[2] * normal[2]);
      for (let c = 0; c < 3; c++) sum[c]! += cosine * irradiance[c]!;
    }
    return sum;
  }

  /**
   * What shiny things mirror: the probe's AMBIENT map in the axes of the scene, from its place, with the share of grey; times `gain` it is in
   * the scene's units. Without a map of this boot, or while the fallback is shown: a coarse one of the SH that are shown.
   */
  reflection(map: ReflectionMap | undefined): { map: ReflectionMap; gain: number } {
    const estimate = this.#last;
    if (!map || !this.#isLit || !estimate || map.bootId !== estimate.bootId) return { map: coarseMap(this.coefficients), gain: 1 };
    const moved = estimate.room && this.#placeM && (map.orientation || estimate.frame !== "WORLD") ? reflectionMapAt(map, estimate.room, this.#placeOf(estimate), estimate.frame) : map;
    const turn = (estimate.frame === "WORLD" && map.orientation) || this.turn;
    const there = turn[3] === 1 ? moved : reflectionMapTurned(moved, inverse(turn));
    if (this.#neutral === 0) return { map: there, gain: this.gain };
    const grey = coarseMap(fallbackEstimate(estimate).sh.coefficients, map.size);
    const faces = there.faces.map((rgb, face) => rgb.map((value, i) => value + this.#neutral * (grey.faces[face]![i]! - value)));
    return { map: { ...there, faces }, gain: this.gain };
  }

  #show(known: Estimate | undefined, go: (target: SceneLight) => void): boolean {
    if (known) {
      this.#gain = this.#exposure.gain(meanIrradiance(known), known.bootId, performance.now());
      [this.#last, this.#fallback] = [known, undefined];
    }
    const { fallback } = this.#options, shown = known ? this.#there(known) : (this.#fallback ??= fallback(this.#last));
    const isOwn = known === undefined && fallback === fallbackEstimate; // it comes from above, however the probe stands
    const target = sceneLight(shown, isOwn || shown.frame === "WORLD" ? SAME : this.turn, this.gain);
    go(known && this.#neutral > 0 ? mixed(target, sceneLight(fallbackEstimate(shown), SAME, this.gain), this.#neutral) : target);
    const hasChanged = this.#isLit !== (known !== undefined);
    this.#isLit = known !== undefined;
    return hasChanged;
  }

  /** The place in the axes of an estimate. */
  #placeOf({ frame }: Estimate): Vec3 {
    return frame === "WORLD" ? this.#placeM! : turned(inverse(this.turn), this.#placeM!);
  }

  #there(known: Estimate): Estimate {
    if (!this.#placeM) return known;
    const placeM = this.#placeOf(known), before = this.#moved;
    if (before && before.from === known && before.placeM.every((value, a) => value === placeM[a])) return before.there;
    const there = estimateAt(known, placeM);
    this.#moved = { from: known, placeM, there };
    return there;
  }
}

const exposureOf = (value: number | "auto"): Exposure => new Exposure(value === "auto" ? undefined : bounded("exposure", value, 0));

/** Light of which a share is replaced by that of `grey`, which has no lamps. */
function mixed({ coefficients, lamps }: SceneLight, grey: SceneLight, share: number): SceneLight {
  return {
    coefficients: Array.from({ length: 27 }, (_, i) => (1 - share) * (coefficients[i] ?? 0) + share * (grey.coefficients[i] ?? 0)),
    lamps: lamps.map((lamp) => ({ ...lamp, irradiance: lamp.irradiance.map((value) => (1 - share) * value) as unknown as Vec3 })),
  };
}
