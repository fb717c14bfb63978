// SPDX-License-Identifier: Apache-2.0
/** Which engine draws the page, and what it reads otherwise than the specification of WebXR's light estimation says. */

import { luminance } from "../estimate.js";
import type { ReflectionMap } from "../reflection.js";
import * as sh from "../sh.js";
import type { Shown } from "./fading.js";
import type { Quirks, ShimOptions } from "./options.js";

/** A scene of three.js, as far as it is looked at. */
interface SceneLike { isScene?: boolean; environment?: { isCubeTexture?: boolean; isRenderTargetTexture?: boolean } | null }

/**
 * The scenes of three.js in the page, also those of A-Frame and <model-viewer>: each tells tools of developers that it is there. To be made
 * before three.js is loaded.
 */
export class Scenes {
  readonly #all: WeakRef<SceneLike>[] = [];

  constructor(global: { __THREE_DEVTOOLS__?: EventTarget } = globalThis as { __THREE_DEVTOOLS__?: EventTarget }) {
    const tools = (global.__THREE_DEVTOOLS__ ??= new EventTarget());
    tools.addEventListener("observe", ({ detail }: Event & { detail?: SceneLike }) => { if (detail?.isScene) this.#all.push(new WeakRef(detail)); });
  }

  /**
   * One has the cube map of light estimation as its environment: in three.js a cube that a renderer draws. Its materials then add the light of
   * the environment to that of the SH.
   */
  haveMap(): boolean {
    return this.#all.some((one) => {
      const environment = one.deref()?.environment;
      return Boolean(environment?.isCubeTexture && environment.isRenderTargetTexture);
    });
  }
}

/** The newest versions that were tried (major, minor); what a later one reads is not known. */
const TRIED = { babylon: [9, 99], aframe: [1, 8] } as const;

/** `version`: "9.35.0", or undefined where the page does not say it. */
function isTried(name: keyof typeof TRIED, version: string | undefined, warn: (text: string) => void): boolean {
  const [major = 0, minor = 0] = (version ?? "0").split(".").map(Number), [most, mostMinor] = TRIED[name];
  if (major < most || (major === most && minor <= mostMinor)) return true;
  warn(`${name} ${version} is newer than what was tried: it gets light as the specification says. data-quirks="${name}" gives it as to older versions`);
  return false;
}

/** What the engine of a page reads otherwise. Babylon.js writes its name into its canvas; A-Frame has an element of its own. */
export function quirksOf(page: Document, asked: ShimOptions["quirks"], warn: (text: string) => void): Quirks {
  if (asked !== "auto") return asked;
  if (page.querySelector("a-scene")) {
    const { AFRAME } = globalThis as { AFRAME?: { version?: string } };
    return isTried("aframe", AFRAME?.version, warn) ? "aframe" : "none";
  }
  const canvas = page.querySelector<HTMLElement>('canvas[data-engine^="Babylon"]');
  const version = canvas && /v(\d[\d.]*)/.exec(canvas.dataset["engine"] ?? "")?.[1];
  return canvas && isTried("babylon", version ?? undefined, warn) ? "babylon" : "none";
}

/**
 * By coefficient. Babylon.js (9.35) takes the SH of every frame but the first for irradiance over π, with the basis' constants in them,
 * and as if z were mirrored.
 */
const BABYLON = [0.2820948, 0.325735, -0.325735, 0.325735, 0.2731371, -0.2731371, 0.0788479, -0.2731371, 0.1365686];
/** A-Frame (1.8) multiplies the SH by this. */
const AFRAME_FACTOR = 3.14;
/** A-Frame divides by the main light's intensity. */
const LEAST_MAIN = 1e-6;

/** Babylon.js takes no main light above 1: what is more goes into the SH. */
function within1({ coefficients, direction, irradiance }: Shown): Shown {
  const most = Math.max(...irradiance);
  if (most <= 1) return { coefficients, direction, irradiance };
  const [r, g, b] = irradiance, more = 1 - 1 / most, all = Array.from(coefficients);
  sh.addLamp(all, direction, [more * r, more * g, more * b]);
  return { coefficients: Float32Array.from(all), direction, irradiance: [r / most, g / most, b / most] };
}

/** What to tell an engine so that it shows `shown`. */
export function adapted(shown: Shown, quirks: Quirks): Shown {
  if (quirks === "babylon") {
    const { coefficients, direction, irradiance } = within1(shown);
    return { coefficients: coefficients.map((value, i) => value * BABYLON[Math.floor(i / 3)]!), direction, irradiance };
  }
  if (quirks === "none") return shown;
  const irradiance = luminance(shown.irradiance) > 0 ? shown.irradiance : ([LEAST_MAIN, LEAST_MAIN, LEAST_MAIN] as const);
  return { ...shown, coefficients: shown.coefficients.map((value) => value / AFRAME_FACTOR), irradiance };
}

/** The map for an engine: Babylon.js looks it up as if z were mirrored. */
export function adaptedMap(map: ReflectionMap, quirks: Quirks): ReflectionMap {
  return quirks === "babylon" ? mirroredZ(map) : map;
}

/** +Z and −Z change places. Columns of all faces but ±Y run the other way, of these the rows do (reflection.ts, FACE_AXES). */
function mirroredZ({ faces, ...rest }: ReflectionMap): ReflectionMap {
  const [px, nx, py, ny, pz, nz] = faces as [Float32Array, Float32Array, Float32Array, Float32Array, Float32Array, Float32Array];
  const { size } = rest, last = size - 1;
  const flipped = (face: Float32Array, byRows: boolean): Float32Array<ArrayBuffer> => {
    const out = new Float32Array(face.length);
    for (let row = 0; row < size; row++)
      for (let column = 0; column < size; column++) {
        const from = 3 * ((byRows ? last - row : row) * size + (byRows ? column : last - column)), to = 3 * (row * size + column);
        for (let c = 0; c < 3; c++) out[to + c] = face[from + c]!;
      }
    return out;
  };
  return { ...rest, faces: [flipped(px, false), flipped(nx, false), flipped(py, true), flipped(ny, true), flipped(nz, false), flipped(pz, false)] };
}
