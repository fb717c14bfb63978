// SPDX-License-Identifier: Apache-2.0
/** For PlayCanvas: lights the scene of an app. */

import { ADDRESS_CLAMP_TO_EDGE, Color, Entity, EnvLighting, FILTER_LINEAR, PIXELFORMAT_RGBA16F, Quat, StandardMaterial, Texture, Vec3 as PlayVec3, type AppBase } from "playcanvas";
import type { Probe } from "./client.js";
import { cubeTexels } from "./cube.js";
import type { Vec3 } from "./estimate.js";
import { Feed, type FeedOptions } from "./feed.js";
import type { Slot } from "./fading.js";
import { mirroredMap, type SceneMap } from "./scene_map.js";
import type { ShownLight } from "./shown_light.js";
import * as sh from "./sh.js";

export interface ProbeLightOptions extends Omit<FeedOptions, "shadowRegionM"> {
  /** How far from the camera there are shadows, in metres; default 10. */
  shadowDistanceM?: number;
}

/**
 * Lamps are directional lights below an entity of its own in `app.root`. Reflections are `app.scene.envAtlas`. Materials below an entity that is
 * given to `apply()` have the rest of the light from the spherical harmonics; others have it from the atlas.
 * @example
 * const light = new ProbeLight(app, { url: "ws://127.0.0.1:7701/" });
 * light.apply(app.root);
 */
export class ProbeLight {
  readonly #app: AppBase;
  readonly #feed: Feed;
  readonly #root = new Entity("lightprobe");
  readonly #lamps: Entity[];
  readonly #castShadow: boolean;
  /** Terms of PlayCanvas' shader: 1, x, y, z, xz, yz, xy, 3z² − 1, x² − y². Materials keep a reference. */
  readonly #ambient = new Float32Array(27);
  readonly #materials = new Set<StandardMaterial>();
  #atlas: Texture | undefined;
  readonly #onUpdate = (): void => this.#frame();

  /** Connects, and moves on before every frame of the app; throws what Probe does. */
  constructor(app: AppBase, options: ProbeLightOptions = {}) {
    const { castShadow = true, shadowMapSize = 1024, shadowDistanceM = 10 } = options;
    this.#app = app;
    this.#feed = new Feed(options);
    this.#castShadow = castShadow;
    this.#lamps = Array.from({ length: this.shown.lamps }, (_, i) => {
      const lamp = new Entity(`lightprobe ${i}`);
      lamp.addComponent("light", { type: "directional", intensity: 1, castShadows: castShadow, shadowResolution: shadowMapSize, shadowDistance: shadowDistanceM, shadowBias: 0.2, normalOffsetBias: 0.05 });
      lamp.enabled = false;
      this.#root.addChild(lamp);
      return lamp;
    });
    app.root.addChild(this.#root);
    app.on("update", this.#onUpdate);
  }

  get probe(): Probe {
    return this.#feed.probe;
  }

  /** What is shown: `strength` and `neutral` may be set. */
  get shown(): ShownLight {
    return this.#feed.light;
  }

  /** Entities with the directional lights; those that show a lamp are enabled. */
  get lamps(): readonly Entity[] {
    return [...this.#lamps];
  }

  /** Show the light of a place: x, y, z in metres from the probe, axes of the scene; undefined: where the probe is. */
  at(positionM: Vec3 | undefined): void {
    this.#feed.at(positionM);
  }

  /** Light the standard materials of all that is rendered below `entity` by the spherical harmonics. Call it again for what is added later. */
  apply(entity: Entity): void {
    const meshes = [...entity.findComponents("render"), ...entity.findComponents("model")].flatMap(({ meshInstances }) => meshInstances ?? []);
    for (const { material } of meshes) {
      if (!(material instanceof StandardMaterial) || this.#materials.has(material)) continue;
      this.#materials.add(material);
      Object.assign(material, { ambientSH: this.#ambient });
      material.update();
    }
  }

  /** Ends its own connection, and takes its lights, its atlas and its ambient light out of the scene. */
  dispose(): void {
    this.#app.off("update", this.#onUpdate);
    this.#feed.close();
    this.#root.destroy();
    for (const material of this.#materials) {
      Object.assign(material, { ambientSH: null });
      material.update();
    }
    this.#show(undefined);
  }

  #frame(): void {
    this.shown.update(this.probe.latest(), performance.now() / 1000);
    this.#lamps.forEach((lamp, i) => aim(lamp, this.shown.slots[i], this.#castShadow));
    const { one, x, y, z, xy, yz, zx, zz, xx } = sh.polynomial(this.shown.coefficients);
    [one, x, y, z, zx, yz, xy, zz, xx].forEach((rgb, i) => this.#ambient.set(rgb, 3 * i));
    const map = this.#feed.changedMap();
    if (map) this.#show(this.#filtered(map));
  }

  #show(atlas: Texture | undefined): void {
    const { scene } = this.#app;
    if (atlas || scene.envAtlas === this.#atlas) scene.envAtlas = atlas ?? null;
    this.#atlas?.destroy();
    this.#atlas = atlas;
  }

  /** The map, blurred for rough materials. */
  #filtered({ map, gain }: SceneMap): Texture {
    const { faces, size } = cubeTexels(mirroredMap(map, 0), "rgba16f", gain);
    const source = new Texture(this.#app.graphicsDevice, {
      name: "lightprobe", cubemap: true, width: size, height: size, format: PIXELFORMAT_RGBA16F, mipmaps: false, minFilter: FILTER_LINEAR, magFilter: FILTER_LINEAR,
      addressU: ADDRESS_CLAMP_TO_EDGE, addressV: ADDRESS_CLAMP_TO_EDGE, levels: [faces as Uint8Array[]], // half floats, which its types do not have
    });
    const lighting = EnvLighting.generateLightingSource(source, { size: 2 * size });
    const atlas = EnvLighting.generateAtlas(lighting, SAMPLES);
    source.destroy();
    lighting.destroy();
    return atlas;
  }
}

/** For each texel of an atlas; PlayCanvas itself takes 1024 and 2048, for maps of more texels than the probe's. */
const SAMPLES = { numReflectionSamples: 256, numAmbientSamples: 512 };

const direction = new PlayVec3(), turn = new Quat(), colour = new Color();

/** Makes a light what its slot shows; undefined: none has been needed yet. */
function aim(lamp: Entity, slot: Slot | undefined, castShadow: boolean): void {
  const { light } = lamp, [r, g, b] = slot?.irradiance ?? [0, 0, 0], strength = Math.max(r, g, b);
  lamp.enabled = strength > 0;
  if (!slot || !light || strength === 0) return;
  light.color = colour.set(r / Math.PI, g / Math.PI, b / Math.PI).gamma(); // PlayCanvas takes colours to be of sRGB, and divides nothing by π
  light.castShadows = castShadow && !slot.isReflection;
  lamp.setRotation(turn.setFromDirections(PlayVec3.UP, direction.set(...slot.direction))); // light falls along −Y of its entity
}
