// SPDX-License-Identifier: Apache-2.0
/** One WebXR session that asked for light estimation, and the probe's light in it. */

import { adapted, adaptedMap, quirksOf, type Scenes } from "./engine.js";
import { tellReflectionChange, XRLightEstimate, XRLightProbe, type ReflectionFormat } from "./interfaces.js";
import { cubeTexels, type CubeTexels } from "../cube.js";
import type { Quirks, ShimOptions } from "./options.js";
import { LightSource } from "./source.js";

/** A probe of the browser's own light estimation, where it has one. */
export interface NativeProbe extends EventTarget {
  readonly probeSpace: XRSpace;
}

export interface ProbeState {
  session: LitSession;
  format: ReflectionFormat;
  native: NativeProbe | undefined;
}

export class LitSession {
  /** undefined: the address cannot be opened from this page. */
  readonly source: LightSource | undefined;
  isEnded = false;
  readonly #session: XRSession;
  readonly #options: ShimOptions;
  readonly #warn: (text: string) => void;
  readonly #probes = new Set<XRLightProbe>();
  readonly #texels = new Map<ReflectionFormat, { key: number; texels: CubeTexels }>();
  #space: Promise<XRSpace> | undefined;
  #quirks: Quirks | undefined;
  #hasGivenMap = false;

  /** `isNative`: the browser has granted light estimation of its own, too. `scenes`: where data-diffuse does not say it. */
  constructor(session: XRSession, readonly isNative: boolean, options: ShimOptions, readonly scenes: Scenes | undefined, warn: (text: string) => void) {
    this.#session = session;
    this.#options = options;
    this.#warn = warn;
    this.source = this.#connected();
    session.addEventListener("end", () => {
      this.isEnded = true;
      this.source?.close();
    }, { once: true });
  }

  #connected(): LightSource | undefined {
    try {
      const source = new LightSource(this.#options, () => { for (const probe of this.#probes) tellReflectionChange(probe); });
      source.probe.on("state", (state) => { if (state === "waiting" && source.probe.hello && source.probe.lastError) this.#warn(source.probe.lastError); });
      return source;
    } catch (error) {
      this.#warn(`${this.#options.address.split("#")[0]}: ${error instanceof Error ? error.message : String(error)}`);
      return undefined;
    }
  }

  /** Looked up when the page first asks: before, its canvas may not be there. */
  get quirks(): Quirks {
    return (this.#quirks ??= quirksOf(document, this.#options.quirks, this.#warn));
  }

  /** The page has the ambient light in its cube map, and would add that of the SH. */
  #isAmbientInMap(): boolean {
    const { diffuse } = this.#options;
    return this.#hasGivenMap && (diffuse === "map" || (diffuse === "auto" && this.scenes?.haveMap() === true));
  }

  /** What a page should ask for. Babylon.js takes half floats for colours with a gamma, and 8-bit texels as they are sampled: linear. */
  get preferredFormat(): ReflectionFormat {
    return this.quirks === "babylon" ? "srgba8" : "rgba16f";
  }

  /** Engines draw in the axes of the session's local spaces and do not look at probeSpace: light is given in these. */
  space(): Promise<XRSpace> {
    return (this.#space ??= this.#session.requestReferenceSpace("local").catch(() => this.#session.requestReferenceSpace("viewer")));
  }

  async newProbe(): Promise<XRLightProbe> {
    const isFirst = this.#space === undefined, space = await this.space();
    const probe = new XRLightProbe(space, (asking) => this.#expectMaps(asking));
    this.#probes.add(probe);
    if (isFirst && this.#options.isOnHead) this.#followHead(space);
    return probe;
  }

  #expectMaps(probe: XRLightProbe): void {
    this.source?.wantMap();
    if (this.source?.map) setTimeout(() => { if (!this.isEnded) tellReflectionChange(probe); });
  }

  /** In every frame of the session, whether the page asks for light in it or not. */
  #followHead(space: XRSpace): void {
    const follow = (_: number, frame: XRFrame): void => {
      if (this.isEnded) return;
      this.#session.requestAnimationFrame(follow);
      const transform = frame.getViewerPose(space as XRReferenceSpace)?.transform;
      if (!transform) return;
      const { orientation: q, position: p } = transform;
      this.source?.lookFrom({ orientation: [q.x, q.y, q.z, q.w], positionM: [p.x, p.y, p.z] });
    };
    this.#session.requestAnimationFrame(follow);
  }

  /** The light now; null before the first estimate of the probe. */
  estimate(): XRLightEstimate | null {
    const shown = this.source?.shown(performance.now());
    if (!shown) return null;
    const said = adapted(shown, this.quirks);
    return new XRLightEstimate(this.#isAmbientInMap() ? { ...said, coefficients: new Float32Array(27) } : said);
  }

  /** Texels of the newest map as this engine reads them, and their number; undefined before the first. Made once for each map. */
  texels(asked: ReflectionFormat): { key: number; texels: CubeTexels } | undefined {
    const current = this.source?.map;
    if (!current) return undefined;
    const { quirks } = this, format = quirks === "none" ? asked : "rgba16f"; // sampled, both are linear; half floats lose nothing
    const known = this.#texels.get(format);
    this.#hasGivenMap = true;
    if (known?.key === current.key) return known;
    const made = { key: current.key, texels: cubeTexels(adaptedMap(current.map, quirks), format, current.gain) };
    this.#texels.set(format, made);
    return made;
  }
}
