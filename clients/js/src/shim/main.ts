// SPDX-License-Identifier: Apache-2.0
/**
 * lightprobe-webxr.js: one script tag before the scripts of a WebXR page, and its light estimation comes from a probe.
 *
 *   <script src="lightprobe-webxr.js" data-probe="wss://probe.local:7701/#token=…"></script>
 *
 * docs/users/webxr.md has the attributes. Without WebXR in the browser nothing is done.
 */

import { patch } from "./patch.js";
import { readOptions } from "./options.js";
import type { LightSource } from "./source.js";

const warned = new Set<string>();

/** Each sentence once. */
function warn(text: string): void {
  if (warned.has(text)) return;
  warned.add(text);
  console.warn(`lightprobe: ${text}`);
}

/** For the console of a page's author: `lightprobeWebXR.of(session)?.probe.lastError`, `.latest()`. */
export interface LightprobeWebXR {
  /** The light of a session that asked for it; undefined for others. */
  of(session: XRSession): LightSource | undefined;
}

function install(): void {
  if (!navigator.xr || "lightprobeWebXR" in globalThis) return; // no WebXR or no secure context; or the tag is there twice
  const options = readOptions({ ...(document.currentScript as HTMLScriptElement | null)?.dataset }, location.href, warn);
  if (!options) return;
  const { lit } = patch(navigator.xr, options, warn);
  const told: LightprobeWebXR = { of: (session) => lit(session)?.source };
  Object.defineProperty(globalThis, "lightprobeWebXR", { value: told, configurable: true });
}

install();
