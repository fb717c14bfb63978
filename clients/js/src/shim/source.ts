// SPDX-License-Identifier: Apache-2.0
/** The light of a probe for one WebXR session: in its axes, as bright as a page shows it, and there as long as the session is. */

import { Probe } from "../client.js";
import { fallbackEstimate, meanIrradiance, type Estimate } from "../estimate.js";
import { Exposure } from "../exposure.js";
import { sceneLight, type SceneLight } from "../fading.js";
import type { ReflectionMap } from "../reflection.js";
import { reflectionMapTurned } from "../reflection_place.js";
import { COARSE_PERIOD_MS, coarseMap, isAsBefore, type SceneMap } from "../scene_map.js";
import { fromYaw, inverse, SAME, type Quaternion } from "../turn.js";
import { Fading, type Shown } from "./fading.js";
import type { ShimOptions } from "./options.js";

/** Where the head is and how it is turned, in the session's space. */
export interface HeadPose {
  orientation: Quaternion;
  positionM: [number, number, number];
}

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
