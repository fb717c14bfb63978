// SPDX-License-Identifier: Apache-2.0
/** The light of a probe for one WebXR session: in its axes, as bright as a page shows it, and there as long as the session is. */

import { Probe } from "../client.js";
import { besideSh, fallbackEstimate, meanIrradiance, type Estimate } from "../estimate.js";
import { largest, texelDirections, type ReflectionMap } from "../reflection.js";
import { reflectionMapTurned } from "../reflection_place.js";
import * as sh from "../sh.js";
import { Exposure } from "./exposure.js";
import { Fading, type SceneLight, type Shown } from "./fading.js";
import type { ShimOptions } from "./options.js";
import { fromYaw, inverse, SAME, turned, type Quaternion } from "./turn.js";

/** A map in the session's axes. */
export interface SceneMap {
  map: ReflectionMap;
  /** Another number for other texels. */
  key: number;
  /** Factor on its radiance. */
  gain: number;
}

/** Where the head is and how it is turned, in the session's space. */
export interface HeadPose {
  orientation: Quaternion;
  positionM: [number, number, number];
}

/** A map that is made of SH has so many texels along an edge, and comes so often. */
const COARSE = 16, COARSE_PERIOD_MS = 200;

export class LightSource {
  readonly probe: Probe;
  readonly exposure: Exposure;
  readonly #options: ShimOptions;
  readonly #onMap: () => void;
  readonly #fading = new Fading();
  readonly #yaw: Quaternion;
  #head: Quaternion = SAME;
  #poseMs = -Infinity;
  #seen: Estimate | undefined;
  #isFallback = false;
  #target: SceneLight | undefined;
  #gain: number | undefined;
  #map: SceneMap | undefined;
  #wantsMap = false;
  #coarseMs = -Infinity;

  /** Connects; throws what Probe does. `onMap` is called when there is another map. */
  constructor(options: ShimOptions, onMap: () => void) {
    this.#options = options;
    this.#onMap = onMap;
    this.#yaw = fromYaw(options.yawDeg);
    this.exposure = new Exposure(options.exposure === "auto" ? undefined : options.exposure);
    this.probe = new Probe(options.address, { shOrder: 2, maxLights: 1, kind: "AMBIENT", frame: options.isOnHead ? "WORLD" : "PROBE" });
    this.probe.on("reflectionMap", (map) => this.#takeMap(map));
  }

  /** From now on there are reflection maps: of the probe, or coarse ones of its SH where it sends none. */
  wantMap(): void {
    if (this.#wantsMap) return;
    this.#wantsMap = true;
    this.probe.subscribe({ reflectionMap: { size: this.#options.mapSize, kind: "AMBIENT" } });
  }

  get map(): SceneMap | undefined {
    return this.#map;
  }

  /** Tells a probe on the head where the head is now. */
  lookFrom({ orientation, positionM }: HeadPose): void {
    this.#head = orientation;
    const nowMs = performance.now();
    if (nowMs > this.#poseMs && this.probe.sendPose(orientation, nowMs, undefined, { positionM })) this.#poseMs = nowMs; // the daemon wants them in order
  }

  /** The light at a time of performance.now(); undefined before the first estimate. */
  shown(nowMs: number): Shown | undefined {
    const estimate = this.probe.latest();
    if (estimate && (estimate !== this.#seen || this.#isFallback)) this.#aim(estimate, nowMs);
    else if (!estimate && this.#seen && !this.#isFallback) this.#aimAtFallback(this.#seen);
    if (!this.#target) return undefined;
    this.#fading.step(this.#target, nowMs);
    return this.#fading.shown();
  }

  close(): void {
    this.probe.close();
  }

  #aim(estimate: Estimate, nowMs: number): void {
    this.#seen = estimate;
    this.#isFallback = false;
    this.#gain = this.exposure.gain(meanIrradiance(estimate), estimate.bootId, nowMs);
    this.#target = sceneLight(estimate, estimate.frame === "WORLD" ? SAME : this.#probeTurn(), this.#gain);
    if (this.#wantsMap && this.probe.hello?.maxReflectionMapSize === 0 && nowMs >= this.#coarseMs + COARSE_PERIOD_MS) {
      this.#coarseMs = nowMs;
      this.#setMap(coarseMap(this.#target.coefficients), 1);
    }
  }

  /** The neutral light that is as bright as the last one: nothing is known of where light comes from. */
  #aimAtFallback(last: Estimate): void {
    this.#isFallback = true;
    this.#target = sceneLight(fallbackEstimate(last), SAME, this.#gain!);
    if (this.#map) this.#setMap(coarseMap(this.#target.coefficients), 1);
  }

  /** How the probe's axes are turned against the session's, as far as estimates do not say it. */
  #probeTurn(): Quaternion {
    return this.#options.isOnHead ? this.#head : this.#yaw;
  }

  #takeMap(map: ReflectionMap): void {
    if (this.#gain === undefined) this.shown(performance.now());
    if (this.#gain === undefined) return; // nothing says how bright it is to be
    const isKnown = this.probe.latest()?.frame === "WORLD" && map.orientation, turn = isKnown || this.#probeTurn();
    this.#setMap(turn === SAME || turn[3] === 1 ? map : reflectionMapTurned(map, inverse(turn)), this.#gain);
  }

  #setMap(map: ReflectionMap, gain: number): void {
    if (this.#map && isAsBefore(this.#map, map, gain)) return;
    this.#map = { map, gain, key: (this.#map?.key ?? 0) + 1 };
    this.#onMap();
  }
}

/** No texel has changed by more than this share of the brightest: engines filter each new map, which takes them long. */
const UNCHANGED = 0.002;

/** It is the same light, within {@link UNCHANGED}. */
export function isAsBefore(before: SceneMap, map: ReflectionMap, gain: number): boolean {
  if (before.map.size !== map.size) return false;
  const most = UNCHANGED * gain * largest(map);
  for (let face = 0; face < 6; face++) {
    const now = map.faces[face]!, old = before.map.faces[face]!;
    for (let i = 0; i < now.length; i++) if (Math.abs(gain * now[i]! - before.gain * old[i]!) > most) return false;
  }
  return true;
}

/** An estimate in axes into which `turn` turns its own, times `gain`. */
export function sceneLight(estimate: Estimate, turn: Quaternion, gain: number): SceneLight {
  const back = inverse(turn);
  return {
    coefficients: sh.rotate(estimate.sh.coefficients, (d) => turned(back, d)).map((value) => gain * value),
    lamps: besideSh(estimate).map(({ id, direction, irradiance: [r, g, b] }) => (
      { key: `${estimate.bootId}/${id}`, direction: turned(turn, direction), irradiance: [gain * r, gain * g, gain * b] })),
  };
}

/** What SH of radiance say of each direction, nowhere below 0. */
function coarseMap(coefficients: ArrayLike<number>): ReflectionMap {
  const towards = texelDirections(COARSE), texels = COARSE * COARSE;
  const faces = Array.from({ length: 6 }, (_, face) => {
    const rgb = new Float32Array(3 * texels);
    for (let i = 0; i < texels; i++) {
      const at = 3 * (face * texels + i), light = sh.radiance(coefficients, [towards[at]!, towards[at + 1]!, towards[at + 2]!]);
      rgb.set(light.map((value) => Math.max(0, value)), 3 * i);
    }
    return rgb;
  });
  return { sequence: 0, bootId: 0, captureTimeUnixMs: 0, subscription: 0, kind: "AMBIENT", size: COARSE, faces, orientation: undefined };
}
