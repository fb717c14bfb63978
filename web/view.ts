// SPDX-License-Identifier: Apache-2.0
/** The picture: objects in the probe's light, and in another light beside them or behind a line that the user moves. It needs WebGL 2; all else on the page does not. */
import * as THREE from "three";
import { meanIrradiance } from "../src/index.js";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { ProbeLight } from "../src/three.js";
import { ArView } from "./ar.js";
import { Stage } from "./scene.js";
import { startXr } from "./xr.js";

/** Lamps that are listed, and KEY. */
export const MOST_LAMPS = 4;
const SLOTS = MOST_LAMPS + 1;
const SLOW_MS = 50, WARM_UP_FRAMES = 3;
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;

/** On a slow machine fewer pixels, smaller shadow maps, plainer glass, and pauses, so that the page stays alive. */
const LEVELS = [{ pixels: 0.7, shadowMap: 512, plain: false }, { pixels: 0.5, shadowMap: 256, plain: true }];

/** Another light to compare with. */
export interface Other {
  estimate: Estimate;
  /** Where the picture is split, 0…1 from the left; undefined: the same objects stand beside. */
  splitAt: number | undefined;
}

/** Columns of the canvas, in its own pixels. */
interface Columns { left: number; width: number }

/** What a frame shows. */
export interface Seen {
  /** The newest, or the fallback: the picture is exposed for it. */
  estimate: Estimate;
  /** False: it is the fallback. */
  isOfProbe: boolean;
  /** What the switches leave of it. */
  shown: Estimate;
  other: Other | undefined;
  /** What objects mirror where they stand. */
  map: ReflectionMap | undefined;
  /** The same as the probe sent it. */
  mapOfProbe: ReflectionMap | undefined;
  turns: boolean;
  /** Objects on the marker mirror the ground that the camera sees. */
  mirrorsGround: boolean;
}

export class View {
  readonly stage: Stage;
  readonly #canvas: HTMLCanvasElement;
  readonly #renderer: THREE.WebGLRenderer;
  readonly #ar: ArView;
  readonly #lights = { probe: new ProbeLight({ lamps: SLOTS }), other: new ProbeLight({ lamps: SLOTS }) };
  readonly #read: () => Seen;
  #exposure = 0;
  #hadLight = false;
  #frames = 0;
  #lastMs = 0;
  #gapMs = 16;
  #restMs = 0;
  #level = 0;

  /**
   * Draws what `read` gives, from now on. `fieldDeg`: of the device's camera along the longer side of its picture. Throws what
   * three.js throws where there is no WebGL 2.
   */
  constructor(canvas: HTMLCanvasElement, fieldDeg: number, read: () => Seen) {
    this.#canvas = canvas;
    this.#read = read;
    this.#renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    this.#renderer.shadowMap.enabled = true;
    this.#renderer.shadowMap.type = THREE.VSMShadowMap;
    this.#renderer.toneMapping = THREE.ACESFilmicToneMapping;
    this.#renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    this.stage = new Stage(this.#renderer);
    this.stage.scene.add(this.#lights.probe, this.#lights.other);
    this.#ar = new ArView(this.#renderer, fieldDeg);
    this.#renderer.setAnimationLoop((nowMs: number) => { this.#frame(nowMs); });
  }

  /** The objects stand on a marker that the camera sees. */
  get isOnMarker(): boolean {
    return this.#ar.isOn && this.#ar.place !== undefined;
  }

  /** The objects on the floor of the real room, by WebXR. Rejects with what the browser says. */
  async enterRoom(): Promise<void> {
    this.hideCamera();
    this.stage.simplifyGlass(); // the bent picture would be of the objects alone: the room is not in it
    await startXr(this.#renderer, () => { this.stage.overPicture(false); });
    this.stage.overPicture(true);
    this.stage.scene.background = null;
  }

  /** The picture of the device's camera behind the objects. Rejects with what the browser says. */
  async showCamera(): Promise<void> {
    await this.#ar.start();
    this.stage.overPicture(true);
    this.stage.scene.background = this.#ar.picture;
    this.stage.scene.backgroundIntensity = 1;
    this.stage.scene.backgroundBlurriness = 0;
  }

  hideCamera(): void {
    this.#ar.stop();
    this.stage.overPicture(false);
    this.stage.setGround(undefined);
    this.stage.lookFrom(undefined);
    document.getElementById("marker")!.hidden = true;
  }

  #frame(nowMs: number): void {
    if (this.#renderer.xr.isPresenting) return this.#frameInRoom(nowMs);
    if (!this.#mayDraw(nowMs)) return;
    const { clientWidth: width, clientHeight: height } = this.#canvas;
    const size = this.#renderer.getSize(new THREE.Vector2());
    if (size.x !== width || size.y !== height) this.#renderer.setSize(width, height, false);
    const seen = this.#read();
    if (seen.turns && !STILL) this.stage.azimuth += 0.004;
    this.#light(seen, nowMs);
    this.#drawBoth(seen, width, height, nowMs);
    this.#count(seen.estimate);
  }

  #drawBoth({ shown, map, estimate, mapOfProbe, mirrorsGround, other }: Seen, width: number, height: number, nowMs: number): void {
    const split = other?.splitAt === undefined ? undefined : Math.round(other.splitAt * width);
    const half = other && split === undefined ? Math.floor(width / 2) : width, edge = split ?? half;
    this.#updateCamera(nowMs, half / height, { estimate, mapOfProbe, mirrorsGround });
    this.stage.aim(half / height);
    this.#renderer.setScissorTest(true);
    this.#draw("probe", shown, map, { left: 0, width: half }, { left: 0, width: edge }, height, nowMs);
    document.getElementById("right")!.hidden = !other;
    if (!other) return;
    if (split === undefined) this.#lights.other.update(other.estimate, nowMs / 1000);
    else this.#lights.other.set(other.estimate);
    const whole = split === undefined ? { left: half, width: width - half } : { left: 0, width };
    this.#draw("other", other.estimate, undefined, whole, { left: edge, width: width - edge }, height, nowMs);
  }

  /** A frame of an XR session: the device's own view, and nothing beside it. */
  #frameInRoom(nowMs: number): void {
    const seen = this.#read(), light = this.#lights.probe;
    this.#light(seen, nowMs);
    light.visible = true;
    this.#lights.other.visible = false;
    this.#gapMs += 0.3 * (Math.min(nowMs - this.#lastMs, 1000) - this.#gapMs);
    this.#lastMs = nowMs;
    this.stage.environment(seen.shown, seen.map, "probe", nowMs, Math.max(400, 20 * this.#gapMs)); // costs more than a frame does
    this.stage.catcher.update(light);
    this.#renderer.setScissorTest(false);
    this.#renderer.render(this.stage.scene, this.stage.camera);
    this.#count(seen.estimate);
  }

  /** The view fills `whole`; of it `part` is drawn. */
  #draw(who: "probe" | "other", shown: Estimate | undefined, map: ReflectionMap | undefined, whole: Columns, part: Columns, height: number, nowMs: number): void {
    if (part.width <= 0) return;
    this.#lights.probe.visible = who === "probe";
    this.#lights.other.visible = who === "other";
    this.stage.environment(shown, map, who, nowMs, 400 + 20 * this.#restMs);
    this.stage.catcher.update(this.#lights[who]);
    this.#renderer.setViewport(whole.left, 0, whole.width, height);
    this.#renderer.setScissor(part.left, 0, part.width, height);
    this.#renderer.render(this.stage.scene, this.stage.camera);
  }

  /** False: rest now. */
  #mayDraw(nowMs: number): boolean {
    const passedMs = nowMs - this.#lastMs;
    if (passedMs < this.#restMs) return false;
    this.#lastMs = nowMs;
    if (this.#frames < WARM_UP_FRAMES) return true; // shaders are compiled
    this.#gapMs += 0.3 * (Math.min(passedMs - this.#restMs, 1000) - this.#gapMs);
    this.#restMs = this.#gapMs > SLOW_MS ? this.#gapMs : 0;
    const next = LEVELS[this.#level];
    if (this.#gapMs > SLOW_MS && next) {
      this.#level++;
      this.#renderer.setPixelRatio(next.pixels);
      for (const light of Object.values(this.#lights)) light.setShadowMapSize(next.shadowMap);
      if (next.plain) this.stage.simplifyGlass();
    }
    return true;
  }

  /**
   * Light fades, and brightness follows it slowly, as eyes do; but the fallback of before the first light and that light are each
   * shown at once, because nothing says how bright one is against the other.
   */
  #light(seen: Seen, nowMs: number): void {
    const begins = this.#exposure === 0 || (seen.isOfProbe && !this.#hadLight);
    this.#hadLight ||= seen.isOfProbe;
    if (begins) this.#lights.probe.set(seen.shown);
    else this.#lights.probe.update(seen.shown, nowMs / 1000);
    const wanted = 1.05 / Math.max(1e-9, meanIrradiance(seen.estimate));
    this.#exposure += (begins ? 1 : 0.05) * (wanted - this.#exposure);
    this.#renderer.toneMappingExposure = this.#exposure;
  }

  /** The camera's newest picture; the view from the marker, if there is one. */
  #updateCamera(nowMs: number, aspect: number, { estimate, mapOfProbe, mirrorsGround }: Pick<Seen, "estimate" | "mapOfProbe" | "mirrorsGround">): void {
    if (!this.#ar.isOn) return;
    this.#ar.update(nowMs, estimate, mapOfProbe);
    const { place } = this.#ar, ground = mirrorsGround ? this.#ar.ground : undefined;
    this.stage.lookFrom(place, this.#ar.cover(aspect));
    this.stage.setGround(ground);
    document.body.dataset["ground"] = ground ? ground.gain.toPrecision(4) : "";
    document.body.dataset["camera"] = place ? place.elements.map((value) => value.toFixed(4)).join(" ") : "";
    document.getElementById("marker")!.hidden = place !== undefined;
  }

  #count(estimate: Estimate): void {
    document.body.dataset["frames"] = String(++this.#frames);
    document.body.dataset["sequence"] = String(estimate.sequence); // 0: the fallback
  }
}
