// SPDX-License-Identifier: Apache-2.0
/** For react-three-fiber: `<ProbeLight url="ws://127.0.0.1:7701/" />` within a `<Canvas shadows>` lights its scene. */

import { useFrame } from "@react-three/fiber";
import { createElement, useEffect, useState, type ReactElement } from "react";
import { LiveProbeLight, type ProbeLightOptions } from "./three.js";
import type { FeedOptions } from "./feed.js";

/** `strength`, `neutral`, `exposure` and `at` may change from frame to frame; a change of another one connects anew, but for `fallback`, which counts as it is then. */
export type ProbeLightProps = ProbeLightOptions & FeedOptions;

/** Connects while it is mounted. Errors of an address that is none go to the next error boundary. */
export function ProbeLight(props: ProbeLightProps): ReactElement | null {
  const [light, setLight] = useState<LiveProbeLight | undefined>(undefined);
  const { url, probe, lamps, fadeS, yawDeg, reflections, castShadow, shadowMapSize, shadowRegionM, shadowHeightM } = props;
  const { strength = 1, neutral = 0, exposure = "auto" } = props, [x, y, z] = props.at ?? [0, 0, 0];
  useEffect(() => {
    const made = new LiveProbeLight(props);
    setLight(made);
    return () => made.dispose();
  }, [url, probe, lamps, fadeS, yawDeg, reflections, castShadow, shadowMapSize, shadowRegionM, shadowHeightM]);
  useEffect(() => { if (light) Object.assign(light.shown, { strength, neutral }); }, [light, strength, neutral]);
  useEffect(() => { if (light) light.shown.exposure = exposure; }, [light, exposure]);
  useEffect(() => light?.at([x, y, z]), [light, x, y, z]);
  useFrame(({ gl, scene }) => light?.frame(performance.now() / 1000, gl, scene));
  return light ? createElement("primitive", { object: light }) : null;
}
