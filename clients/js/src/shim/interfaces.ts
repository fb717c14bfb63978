// SPDX-License-Identifier: Apache-2.0
/** The interfaces of https://www.w3.org/TR/webxr-lighting-estimation-1/ that a page meets. */

import type { Shown } from "./fading.js";

export type ReflectionFormat = "srgba8" | "rgba16f";

const REFLECTION_CHANGE = "reflectionchange";

/** Where the light is estimated, and the event that there is another reflection map. */
export class XRLightProbe extends EventTarget {
  readonly #space: XRSpace;
  readonly #onListener: (probe: XRLightProbe) => void;
  #handler: ((event: Event) => unknown) | null = null;

  /** Of requestLightProbe() alone. `onListener` is called when somebody wants to know of reflection maps. */
  constructor(space: XRSpace, onListener: (probe: XRLightProbe) => void) {
    super();
    this.#space = space;
    this.#onListener = onListener;
    super.addEventListener(REFLECTION_CHANGE, (event) => this.#handler?.call(this, event));
  }

  /** Directions and coefficients are in the axes of this space. */
  get probeSpace(): XRSpace {
    return this.#space;
  }

  get onreflectionchange(): ((event: Event) => unknown) | null {
    return this.#handler;
  }

  set onreflectionchange(handler: ((event: Event) => unknown) | null) {
    this.#handler = typeof handler === "function" ? handler : null;
    if (this.#handler) this.#onListener(this);
  }

  override addEventListener(...all: Parameters<EventTarget["addEventListener"]>): void {
    super.addEventListener(...all);
    if (all[0] === REFLECTION_CHANGE && all[1]) this.#onListener(this);
  }

  get [Symbol.toStringTag](): string {
    return "XRLightProbe";
  }
}

export const tellReflectionChange = (probe: XRLightProbe): boolean => probe.dispatchEvent(new Event(REFLECTION_CHANGE));

/** The light of one frame. */
export class XRLightEstimate {
  readonly #coefficients: Float32Array<ArrayBuffer>;
  readonly #direction: DOMPointReadOnly;
  readonly #intensity: DOMPointReadOnly;

  constructor({ coefficients, direction: [x, y, z], irradiance: [r, g, b] }: Shown) {
    this.#coefficients = coefficients;
    this.#direction = new DOMPointReadOnly(x, y, z, 0);
    this.#intensity = new DOMPointReadOnly(r, g, b, 1);
  }

  /** 27 numbers r0 g0 b0 r1 …: radiance without the main light; orthonormal, positive. */
  get sphericalHarmonicsCoefficients(): Float32Array<ArrayBuffer> {
    return this.#coefficients;
  }

  /** Unit vector towards the main light. */
  get primaryLightDirection(): DOMPointReadOnly {
    return this.#direction;
  }

  /** RGB irradiance of the main light on a surface that faces it, linear; (0, 0, 0) when there is none. */
  get primaryLightIntensity(): DOMPointReadOnly {
    return this.#intensity;
  }

  get [Symbol.toStringTag](): string {
    return "XRLightEstimate";
  }
}
