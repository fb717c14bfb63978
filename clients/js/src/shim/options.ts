// SPDX-License-Identifier: Apache-2.0
/** What the script tag of lightprobe-webxr.js says. */

import { parseAddress } from "../client.js";

export type Quirks = "none" | "babylon" | "aframe";
export type Diffuse = "sh" | "map";

export interface ShimOptions {
  /** Of the probe: ws:, wss:, http: or https:, as the client takes it. */
  address: string;
  /** By how many degrees the probe's −Z is turned to the left of the session's −Z. */
  yawDeg: number;
  /** The probe sits on the head: poses are sent, and light comes in the session's axes. */
  isOnHead: boolean;
  /** Factor on all light; auto: chosen by the brightness of the room (exposure.ts). */
  exposure: number | "auto";
  /** Where diffuse surfaces of the page get the ambient light from; auto: by what its scenes of three.js have (engine.ts). */
  diffuse: Diffuse | "auto";
  /** What an engine reads otherwise than the specification says; auto: by the engine. */
  quirks: Quirks | "auto";
  mapSize: 16 | 32 | 64;
}

/** Attributes without "data-", as HTMLElement.dataset has them. */
export type Attributes = Readonly<Record<string, string | undefined>>;

const shown = (text: string): string => JSON.stringify(text.slice(0, 60));

/** A number within bounds; what is none is told, and the default stays. */
function numberOf(data: Attributes, name: string, otherwise: number, least: number, most: number, warn: (text: string) => void): number {
  const text = data[name]?.trim();
  if (!text) return otherwise;
  const value = Number(text);
  if (value >= least && value <= most) return value;
  warn(`data-${name}: ${shown(text)}: expected a number, ${least}…${most}: ${otherwise} is taken`);
  return otherwise;
}

function choiceOf<T extends string>(data: Attributes, name: string, choices: readonly T[], warn: (text: string) => void): T {
  const text = data[name]?.trim();
  const found = choices.find((one) => one === text);
  if (text && !found) warn(`data-${name}: ${shown(text)}: expected ${choices.join(", ")}: ${choices[0]} is taken`);
  return found ?? choices[0]!;
}

/**
 * `page`: the address of the page; without data-probe its own server is asked. `warn` gets a sentence for what cannot be used.
 * undefined: the address is none.
 */
export function readOptions(data: Attributes, page: string, warn: (text: string) => void): ShimOptions | undefined {
  const address = data["probe"]?.trim() || new URL("/", page).href;
  try {
    parseAddress(address);
  } catch (error) {
    warn(error instanceof Error ? error.message : String(error));
    return undefined;
  }
  const exposure = data["exposure"]?.trim();
  return {
    address,
    yawDeg: numberOf(data, "yaw", 0, -360, 360, warn),
    isOnHead: choiceOf(data, "mount", ["stand", "head"], warn) === "head",
    exposure: !exposure || exposure === "auto" ? "auto" : numberOf(data, "exposure", 1, 1e-9, 1e9, warn),
    diffuse: choiceOf(data, "diffuse", ["auto", "sh", "map"], warn),
    quirks: choiceOf(data, "quirks", ["auto", "none", "babylon", "aframe"], warn),
    mapSize: Number(choiceOf(data, "map", ["32", "16", "64"], warn)) as 16 | 32 | 64,
  };
}
