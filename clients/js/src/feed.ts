// SPDX-License-Identifier: Apache-2.0
/** A component's own connection: it asks the probe for what the component shows, and tells it when reflections have changed. */

import { Probe } from "./client.js";
import type { Vec3 } from "./estimate.js";
import { COARSE_PERIOD_MS, isAsBefore, type SceneMap } from "./scene_map.js";
import { ShownLight, type LightOptions } from "./shown_light.js";

export interface FeedOptions extends LightOptions {
  /** Of the probe: ws://HOST:PORT/, or what `lightprobe pair` prints; default: the page's own server. */
  url?: string;
  /** A client of your own, in place of `url`: subscribed to AMBIENT, and yours to close. */
  probe?: Probe;
  /** What shiny things mirror; default true. Without reflection maps of the probe (`lightprobed --reflection-map=32`): a coarse map of its ambient light. */
  reflections?: boolean;
  /** Directional lights cast shadows; default true. */
  castShadow?: boolean;
  /** Pixels along an edge of a lamp's shadow map; default 1024. */
  shadowMapSize?: number;
  /** Half the width of the region with shadows around the scene's origin, in metres; default 1.5. */
  shadowRegionM?: number;
}

/** Texels along an edge that a component asks for. */
const MAP_SIZE = 32;

/** The light beside the probe follows from SH of order 4 best. */
const isAway = (positionM: Vec3 | undefined): boolean => positionM !== undefined && positionM.some((value) => value !== 0);

export class Feed {
  readonly probe: Probe;
  readonly light: ShownLight;
  readonly #isOwn: boolean;
  readonly #wantsMap: boolean;
  #map: SceneMap | undefined;
  #lookedMs = -Infinity;
  #hasOrder4: boolean;

  /** Connects; throws what Probe and ShownLight do. `light`: of the component; else one is made. */
  constructor(options: FeedOptions, light: ShownLight = new ShownLight(options, "auto")) {
    this.light = light;
    this.#wantsMap = options.reflections ?? true;
    this.#isOwn = options.probe === undefined;
    this.#hasOrder4 = isAway(options.at);
    this.probe = options.probe ?? new Probe(options.url ?? location.href, {
      kind: "AMBIENT", maxLights: light.lamps, shOrder: this.#hasOrder4 ? 4 : 2, ...(this.#wantsMap ? { reflectionMap: { size: MAP_SIZE, kind: "AMBIENT" } } : {}),
    });
  }

  /** Light of another place: see ShownLight.at(). */
  at(positionM: Vec3 | undefined): void {
    this.light.at(positionM);
    if (!isAway(positionM) || !this.#isOwn || this.#hasOrder4) return;
    this.#hasOrder4 = true;
    this.probe.subscribe({ shOrder: 4 });
  }

  /** Once for every frame, after ShownLight.update(): a map that shows other light than the last one that was given; else undefined. */
  changedMap(): SceneMap | undefined {
    const nowMs = performance.now();
    if (!this.#wantsMap || nowMs < this.#lookedMs + COARSE_PERIOD_MS) return undefined;
    this.#lookedMs = nowMs;
    const { map, gain } = this.light.reflection(this.probe.reflectionMap);
    if (this.#map && isAsBefore(this.#map, map, gain)) return undefined;
    return (this.#map = { map, gain, key: (this.#map?.key ?? 0) + 1 });
  }

  /** Ends the connection, unless the probe is yours. */
  close(): void {
    if (this.#isOwn) this.probe.close();
  }
}
