// SPDX-License-Identifier: Apache-2.0
/** For A-Frame: `<a-entity lightprobe="url: ws://127.0.0.1:7701/"></a-entity>` lights its scene. It is built with A-Frame's own three.js. */

import type { Object3D, Scene, WebGLRenderer } from "three";
import { LiveProbeLight } from "./three.js";

/** As A-Frame parses the attribute. */
interface Data {
  url: string;
  lamps: number;
  strength: number;
  neutral: number;
  /** A number, or "auto". */
  exposure: string;
  yaw: number;
  at: { x: number; y: number; z: number };
  reflections: boolean;
  castShadow: boolean;
  shadowMapSize: number;
  shadowRegion: number;
}

interface Component {
  data: Data;
  light: LiveProbeLight | undefined;
  el: {
    setObject3D(name: string, object: Object3D): void;
    removeObject3D(name: string): void;
    sceneEl: {
      renderer: WebGLRenderer;
      object3D: Scene;
      systems: { light: { registerLight(element: object): void }; shadow: { setShadowMapEnabled(isOn: boolean): void } };
    };
  };
}

type Definition = Record<"init" | "tick" | "remove", (this: Component) => void> & { schema: object; update(this: Component, before: Partial<Data>): void };
declare const AFRAME: { registerComponent(name: string, definition: Definition): void };

/** A change of these connects anew. */
const FIXED = ["url", "lamps", "yaw", "reflections", "castShadow", "shadowMapSize", "shadowRegion"] as const;

function make(component: Component): LiveProbeLight {
  const { url, lamps, yaw, reflections, castShadow, shadowMapSize, shadowRegion } = component.data, { systems } = component.el.sceneEl;
  const light = new LiveProbeLight({ url: url || location.href, lamps, yawDeg: yaw, reflections, castShadow, shadowMapSize, shadowRegionM: shadowRegion });
  component.el.setObject3D("lightprobe", light);
  if (castShadow) systems.shadow.setShadowMapEnabled(true);
  return light;
}

function end(component: Component): void {
  if (!component.light) return;
  component.el.removeObject3D("lightprobe");
  component.light.dispose();
  component.light = undefined;
}

AFRAME.registerComponent("lightprobe", {
  schema: {
    url: { type: "string", default: "" }, lamps: { type: "int", default: 4 }, strength: { type: "number", default: 1 }, neutral: { type: "number", default: 0 },
    exposure: { type: "string", default: "auto" }, yaw: { type: "number", default: 0 }, at: { type: "vec3", default: { x: 0, y: 0, z: 0 } },
    reflections: { type: "boolean", default: true }, castShadow: { type: "boolean", default: true },
    shadowMapSize: { type: "int", default: 1024 }, shadowRegion: { type: "number", default: 1.5 },
  },
  init() {
    this.el.sceneEl.systems.light.registerLight(this.el); // A-Frame's own default lights go
  },
  update(before) {
    const isNew = !this.light || FIXED.some((name) => before[name] !== this.data[name]);
    if (isNew) end(this);
    this.light ??= make(this);
    const { strength, neutral, exposure, at } = this.data;
    Object.assign(this.light.shown, { strength, neutral });
    if (isNew || before.exposure !== exposure) this.light.shown.exposure = exposure === "auto" ? "auto" : Number(exposure);
    this.light.at([at.x, at.y, at.z]);
  },
  tick() {
    this.light?.frame(performance.now() / 1000, this.el.sceneEl.renderer, this.el.sceneEl.object3D);
  },
  remove() {
    end(this);
  },
});
