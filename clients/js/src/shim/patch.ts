// SPDX-License-Identifier: Apache-2.0
/** WebXR's own classes, so that they give the light of a probe: sessions, frames, and the binding to WebGL. */

import { fillCube } from "../cube.js";
import { Scenes } from "./engine.js";
import { XRLightEstimate, XRLightProbe, tellReflectionChange, type ReflectionFormat } from "./interfaces.js";
import type { ShimOptions } from "./options.js";
import { LitSession, type NativeProbe, type ProbeState } from "./session.js";

const FEATURE = "light-estimation";

type Context = WebGLRenderingContext | WebGL2RenderingContext;
interface LightProbeInit { reflectionFormat?: ReflectionFormat }

/** What browsers with light estimation of their own have, as far as it is called. */
interface NativeSession { requestLightProbe?: (this: XRSession, init?: LightProbeInit) => Promise<NativeProbe> }
interface NativeFrame { getLightEstimate?: (this: XRFrame, probe: NativeProbe) => unknown }
interface Binding { getReflectionCubeMap?(probe: NativeProbe): WebGLTexture | null }
type BindingClass = new (session: XRSession, gl: Context) => Binding;

/** Everything that is known of sessions, probes and bindings of the page. */
class Known {
  readonly sessions = new WeakMap<XRSession, LitSession>();
  readonly probes = new WeakMap<object, ProbeState>();

  /** Made at once, because three.js tells of scenes when they are made. */
  readonly scenes: Scenes | undefined;

  constructor(readonly options: ShimOptions, readonly warn: (text: string) => void) {
    this.scenes = options.diffuse === "auto" ? new Scenes() : undefined;
  }

  /** The state of a probe that belongs to a session; InvalidStateError, as the specification says, for another. */
  probe(probe: unknown, session: XRSession): ProbeState {
    if (typeof probe !== "object" || probe === null) throw new TypeError("not an XRLightProbe");
    const state = this.probes.get(probe);
    if (!state || this.sessions.get(session) !== state.session) throw new DOMException("the light probe is not one of this session", "InvalidStateError");
    if (state.session.isEnded) throw new DOMException("the session has ended", "InvalidStateError");
    return state;
  }
}

/** What is asked of a session, with light estimation only as a wish: a browser that has none would refuse what it must have. */
function softened(init: XRSessionInit | undefined): { isWanted: boolean; init: XRSessionInit | undefined } {
  const listed = (features: unknown): string[] => (Array.isArray(features) ? (features as string[]) : []);
  const required = listed(init?.requiredFeatures), optional = listed(init?.optionalFeatures);
  if (![...required, ...optional].includes(FEATURE)) return { isWanted: false, init };
  return { isWanted: true, init: { ...init, requiredFeatures: required.filter((name) => name !== FEATURE), optionalFeatures: [...new Set([...optional, FEATURE])] } };
}

function light(known: Known, session: XRSession, nativeRequest: unknown): XRSession {
  const names = session.enabledFeatures && [...session.enabledFeatures]; // undefined in older browsers
  const isNative = Boolean(nativeRequest && names?.includes(FEATURE));
  if (names && !names.includes(FEATURE)) {
    const all = Object.freeze([...names, FEATURE]);
    Object.defineProperty(session, "enabledFeatures", { get: () => all, configurable: true, enumerable: true });
  }
  known.sessions.set(session, new LitSession(session, isNative, known.options, known.scenes, known.warn));
  return session;
}

function patchSystem(known: Known, system: XRSystem, nativeRequest: unknown): void {
  const owner = Object.getPrototypeOf(system) as Record<string, ((mode: XRSessionMode, init?: XRSessionInit) => Promise<XRSession>) | undefined>;
  for (const name of ["requestSession", "offerSession"]) {
    const original = owner[name];
    if (!original) continue;
    owner[name] = async function (this: XRSystem, mode: XRSessionMode, init?: XRSessionInit): Promise<XRSession> {
      const asked = softened(init), session = await original.call(this, mode, asked.init);
      return asked.isWanted ? light(known, session, nativeRequest) : session;
    };
  }
}

function patchSession(known: Known, nativeRequest: NativeSession["requestLightProbe"]): void {
  const owner = XRSession.prototype as XRSession & { requestLightProbe?: unknown };
  owner.requestLightProbe = async function (this: XRSession, init: LightProbeInit = {}): Promise<XRLightProbe> {
    const session = known.sessions.get(this);
    if (!session) throw new DOMException(`${FEATURE} was not asked for when the session was requested`, "NotSupportedError");
    if (session.isEnded) throw new DOMException("the session has ended", "InvalidStateError");
    const format = init.reflectionFormat ?? "srgba8";
    if (format !== "srgba8" && format !== "rgba16f") throw new TypeError(`reflectionFormat: ${String(format)}: expected srgba8 or rgba16f`);
    const native = session.isNative && nativeRequest ? await nativeRequest.call(this, init).catch(() => undefined) : undefined;
    const probe = await session.newProbe();
    native?.addEventListener("reflectionchange", () => { if (!session.source?.map) tellReflectionChange(probe); });
    known.probes.set(probe, { session, format, native });
    return probe;
  };
  const before = Object.getOwnPropertyDescriptor(owner, "preferredReflectionFormat");
  Object.defineProperty(owner, "preferredReflectionFormat", {
    get(this: XRSession): unknown { return known.sessions.get(this)?.preferredFormat ?? before?.get?.call(this) ?? "srgba8"; },
    configurable: true, enumerable: true,
  });
}

function patchFrame(known: Known): void {
  const owner = XRFrame.prototype as XRFrame & NativeFrame, native = owner.getLightEstimate;
  (owner as { getLightEstimate: unknown }).getLightEstimate = function (this: XRFrame, probe: unknown): unknown {
    const state = known.probe(probe, this.session);
    return state.session.estimate() ?? (state.native && native ? native.call(this, state.native) : null);
  };
}

/** The object itself tells neither its session nor its context, so its constructor must be seen. */
function patchBinding(known: Known): void {
  const global = globalThis as { XRWebGLBinding?: BindingClass };
  const Base: BindingClass = global.XRWebGLBinding ?? class {};
  class XRWebGLBinding extends Base {
    readonly #session: XRSession;
    readonly #gl: Context;
    #texture: WebGLTexture | null = null;
    /** Number, size and format of what is in the texture. */
    #key: number | undefined;
    #kind: string | undefined;

    constructor(session: XRSession, gl: Context) {
      super(session, gl);
      this.#session = session;
      this.#gl = gl;
    }

    /** One texture, filled anew with each map; null before the first. It is the binding's: pages do not delete it. */
    override getReflectionCubeMap(probe: unknown): WebGLTexture | null {
      const { session, format, native } = known.probe(probe, this.#session);
      session.source?.wantMap();
      const made = session.texels(format);
      if (!made) return native && super.getReflectionCubeMap ? super.getReflectionCubeMap(native) : null;
      if (!this.#texture || !this.#gl.isTexture(this.#texture)) { // Babylon.js deletes what it has filtered
        this.#texture = this.#gl.createTexture();
        this.#key = this.#kind = undefined;
      }
      if (this.#key === made.key) return this.#texture;
      const kind = `${made.texels.size} ${made.texels.faces[0]!.constructor.name}`;
      if (!fillCube(this.#gl, this.#texture!, made.texels, kind !== this.#kind)) return null;
      this.#key = made.key;
      this.#kind = kind;
      return this.#texture;
    }
  }
  Object.defineProperty(globalThis, "XRWebGLBinding", { value: XRWebGLBinding, configurable: true, writable: true });
}

/**
 * From now on every session of `system` that asks for light estimation gets it from the probe. Nothing is connected before one does.
 * The browser's own light estimation, where it has one, is given until the probe's comes.
 */
export function patch(system: XRSystem, options: ShimOptions, warn: (text: string) => void): { lit(session: XRSession): LitSession | undefined } {
  const known = new Known(options, warn);
  const nativeRequest = (XRSession.prototype as NativeSession).requestLightProbe;
  patchSystem(known, system, nativeRequest);
  patchSession(known, nativeRequest);
  patchFrame(known);
  patchBinding(known);
  for (const [name, value] of Object.entries({ XRLightProbe, XRLightEstimate }))
    if (!(name in globalThis)) Object.defineProperty(globalThis, name, { value, configurable: true, writable: true });
  return { lit: (session) => known.sessions.get(session) };
}
