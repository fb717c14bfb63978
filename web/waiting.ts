// SPDX-License-Identifier: Apache-2.0
/** What the page waits for, in words. */
import type { Probe } from "../src/index.js";

/** The probe's name while its light comes; else what is waited for. `had`: light has come before. */
export function statusOf(probe: Probe, had: boolean): string {
  const { hello, health } = probe;
  if (probe.state === "closed") return "ended";
  if (probe.state !== "open") return hello ? "the probe is gone: connecting again" : "waiting for the connection";
  if (probe.latest()) return hello?.name || "connected";
  const camera = health ? ` (its camera: ${health.sourceState.toLowerCase()})` : "";
  return `connected, waiting for ${had ? "newer" : "the first"} light${camera}`;
}
