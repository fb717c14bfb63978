// SPDX-License-Identifier: Apache-2.0
/** For three.js: a group that lights the scene with a probe's light. Several lamps, soft shadows, no jumps. */

import { CubeReflectionMapping, CubeTexture, DataTexture, DataUtils, DirectionalLight, EquirectangularReflectionMapping, FloatType, Group, HalfFloatType, LightProbe, Mesh, MeshLambertMaterial, MultiplyBlending, LinearFilter, LinearSRGBColorSpace, Quaternion, RGBAFormat } from "three";
import { PMREMGenerator, Vector3, type BufferGeometry, type Object3DEventMap, type Scene, type WebGLRenderer } from "three";
import type { Probe } from "./client.js";
import type { Estimate, Vec3 } from "./estimate.js";
import { Feed, type FeedOptions } from "./feed.js";
import type { Slot } from "./fading.js";
import { largest, type ReflectionMap } from "./reflection.js";
import * as sh from "./sh.js";
import { ShownLight, type LightOptions } from "./shown_light.js";
import { inverse } from "./turn.js";

export interface ProbeLightOptions extends LightOptions {
  /** Default true. */
  castShadow?: boolean;
  /** Pixels along an edge of a lamp's shadow map; default 1024. */
  shadowMapSize?: number;
  /** Half the width of the region with shadows, in metres; default 1.5. */
  shadowRegionM?: number;
  /** Height of what casts shadows, in metres: a shadow's edge is as wide as 2 height tan(angular radius). */
  shadowHeightM?: number;
}

/** As XREstimatedLight's: there is light from now on; there is none any more. */
export interface ProbeLightEvents extends Object3DEventMap {
  estimationstart: object;
  estimationend: object;
}

/**
 * @example
 * const light = new ProbeLight();
 * scene.add(light);
 * renderer.setAnimationLoop((ms) => { light.update(probe.latest(), ms / 1000); renderer.render(scene, camera); });
 */
export class ProbeLight extends Group<ProbeLightEvents> {
  /** SH of the rest of the light; set `ambient.intensity = 0` where an environment map gives it. */
  readonly ambient = new LightProbe();
  /** Takes a direction in the scene to the probe's axes: how the probe stands in the scene. */
  readonly toProbe = new Quaternion();
  /** What is shown: `strength`, `neutral`, `at()` are set here. */
  readonly shown: ShownLight;

  readonly #lights: DirectionalLight[] = [];
  readonly #options: Required<Omit<ProbeLightOptions, keyof LightOptions>>;

  /** `exposure`: where the options have none. */
  constructor(options: ProbeLightOptions = {}, exposure: number | "auto" = 1) {
    super();
    const { castShadow = true, shadowMapSize = 1024, shadowRegionM = 1.5, shadowHeightM = 0.3 } = options;
    this.#options = { castShadow, shadowMapSize, shadowRegionM, shadowHeightM };
    this.shown = new ShownLight(options, exposure);
    this.toProbe.fromArray(inverse(this.shown.turn));
    this.add(this.ambient);
    for (let i = 0; i < this.shown.lamps; i++) this.#lights.push(this.#makeLight());
  }

  /** The directional lights, shown or not. */
  get lamps(): readonly DirectionalLight[] {
    return [...this.#lights];
  }

  /** Move on towards an estimate (undefined: the fallback) by the time that has passed; `timeS` of any clock. */
  update(estimate: Estimate | undefined, timeS: number): void {
    this.#turn();
    this.#present(this.shown.update(estimate, timeS));
  }

  /** Show an estimate at once; undefined: the fallback. */
  set(estimate: Estimate | undefined): void {
    this.#turn();
    this.#present(this.shown.set(estimate));
  }

  /** Irradiance of what is shown now on a surface with this normal, both in the scene's axes. */
  irradiance(normal: Vec3): [number, number, number] {
    return this.shown.irradiance(normal);
  }

  /** Show the light of a place: x, y, z in metres from the probe, axes of the scene; undefined: where the probe is. */
  at(positionM: Vec3 | undefined): void {
    this.shown.at(positionM);
  }

  /** For slower machines. */
  setShadowMapSize(pixels: number): void {
    this.#options.shadowMapSize = pixels;
    for (const { shadow } of this.#lights) {
      shadow.mapSize.set(pixels, pixels);
      shadow.map?.dispose();
      shadow.map = null;
      shadow.needsUpdate = true;
    }
  }

  override dispose(): void {
    for (const light of this.#lights) light.dispose();
  }

  #turn(): void {
    this.shown.turn = inverse(this.toProbe.toArray());
  }

  #present(hasChanged: boolean): void {
    if (hasChanged) this.dispatchEvent({ type: this.shown.isLit ? "estimationstart" : "estimationend" });
    this.#lights.forEach((light, i) => this.#aim(light, this.shown.slots[i]));
    this.ambient.sh.fromArray(Array.from(this.shown.coefficients));
  }

  #makeLight(): DirectionalLight {
    const light = new DirectionalLight(0xffffff, 0);
    const { castShadow, shadowMapSize, shadowRegionM } = this.#options;
    light.castShadow = castShadow;
    light.shadow.mapSize.set(shadowMapSize, shadowMapSize);
    Object.assign(light.shadow.camera, { left: -shadowRegionM, right: shadowRegionM, top: shadowRegionM, bottom: -shadowRegionM, near: 0.1, far: 20 });
    light.shadow.normalBias = 0.01;
    light.shadow.needsUpdate = true; // once also in the dark: shaders read the maps of all lights
    this.add(light, light.target);
    return light;
  }

  /** Makes a light what its slot shows; undefined: none has been needed yet. */
  #aim(light: DirectionalLight, slot: Slot | undefined): void {
    const [r, g, b] = slot?.irradiance ?? [0, 0, 0], strength = Math.max(r, g, b);
    light.intensity = strength;
    light.shadow.autoUpdate = strength > 0; // the shadow of no light is not drawn
    light.castShadow = this.#options.castShadow && !slot?.isReflection;
    if (!slot) return;
    if (strength > 0) light.color.setRGB(r / strength, g / strength, b / strength, LinearSRGBColorSpace);
    light.position.set(...slot.direction).multiplyScalar(10).add(light.target.position);
    const { shadowHeightM, shadowRegionM, shadowMapSize } = this.#options;
    const penumbraM = 2 * shadowHeightM * Math.tan((Math.min(slot.angularRadiusDeg, 40) * Math.PI) / 180);
    light.shadow.radius = Math.max(1, ((penumbraM / 2) * shadowMapSize) / (2 * shadowRegionM));
  }
}

/**
 * A ProbeLight with a connection of its own. With `reflections` (default), the map is `scene.environment`: physical materials then have the
 * ambient light from it, once, and materials without an environment (Lambert, Phong, toon) have lamps alone: choose `reflections: false` for them.
 * @example
 * const light = new LiveProbeLight({ url: "ws://127.0.0.1:7701/" });
 * scene.add(light);
 * renderer.setAnimationLoop((ms) => { light.frame(ms / 1000, renderer, scene); renderer.render(scene, camera); });
 */
export class LiveProbeLight extends ProbeLight {
  readonly #feed: Feed;
  #filter: PMREMGenerator | undefined;
  /** The environment that is shown, and what the scene had before. */
  #filtered: { scene: Scene; target: ReturnType<PMREMGenerator["fromCubemap"]>; before: Scene["environment"]; intensity: number } | undefined;
  #isDisposed = false;

  /** Connects; throws what Probe does. */
  constructor(options: ProbeLightOptions & FeedOptions = {}) {
    super(options, "auto");
    this.#feed = new Feed(options, this.shown);
  }

  get probe(): Probe {
    return this.#feed.probe;
  }

  override at(positionM: Vec3 | undefined): void {
    this.#feed.at(positionM);
  }

  /** Once in every frame, before it is drawn; `timeS` of any clock that is never set. */
  frame(timeS: number, renderer: WebGLRenderer, scene: Scene): void {
    if (this.#isDisposed) return;
    this.update(this.probe.latest(), timeS);
    const found = this.#feed.changedMap();
    if (!found) return;
    this.#filter ??= new PMREMGenerator(renderer);
    const { texture, intensity } = reflectionTexture(found.map), target = this.#filter.fromCubemap(texture);
    texture.dispose();
    this.#forget();
    this.#filtered = { scene, target, before: scene.environment, intensity: scene.environmentIntensity };
    scene.environment = target.texture;
    scene.environmentIntensity = intensity * found.gain;
    this.ambient.intensity = 0;
  }

  #forget(): void {
    if (!this.#filtered) return;
    const { scene, target, before, intensity } = this.#filtered;
    if (scene.environment === target.texture) Object.assign(scene, { environment: before, environmentIntensity: intensity });
    target.dispose();
    this.#filtered = undefined;
  }

  /** Ends its own connection, and takes its environment out of the scene. */
  override dispose(): void {
    this.#isDisposed = true;
    this.#feed.close();
    this.#forget();
    this.#filter?.dispose();
    super.dispose();
  }
}

/**
 * Radiance of the SH all around, as an equirectangular environment for PMREMGenerator: what metal and glass show where
 * there is no reflection map. Lamps are not in it: directional lights give their highlights.
 */
export function ambientEnvironment(estimate: Estimate, widthPx = 64): DataTexture {
  const heightPx = widthPx / 2;
  const data = new Float32Array(4 * widthPx * heightPx);
  for (let row = 0; row < heightPx; row++) {
    // three.js samples row 0 at the bottom; its u = 0.5 + atan2(z, x) / 2π.
    const y = Math.sin(((row + 0.5) / heightPx - 0.5) * Math.PI), radius = Math.sqrt(1 - y * y);
    for (let column = 0; column < widthPx; column++) {
      const angle = ((column + 0.5) / widthPx - 0.5) * 2 * Math.PI;
      const light = sh.radiance(estimate.sh.coefficients, [radius * Math.cos(angle), y, radius * Math.sin(angle)]);
      const at = 4 * (row * widthPx + column);
      for (let c = 0; c < 3; c++) data[at + c] = Math.max(0, light[c]!); // SH ring below zero
      data[at + 3] = 1;
    }
  }
  const texture = new DataTexture(data, widthPx, heightPx, RGBAFormat, FloatType);
  texture.mapping = EquirectangularReflectionMapping;
  texture.colorSpace = LinearSRGBColorSpace;
  texture.minFilter = texture.magFilter = LinearFilter;
  texture.needsUpdate = true;
  return texture;
}

/** Largest value of a texture of half floats; the lamps of a probe exceed it. */
const MOST_HALF = 60000;

/**
 * A reflection map as a cube texture, for `envMap` (as it is on MeshLambert, MeshBasic; through PMREMGenerator.fromCubemap()
 * for physical materials) and for `scene.background`. Multiply by `intensity` (`envMapIntensity`, `environmentIntensity`,
 * `backgroundIntensity`): the texture itself stays within half floats.
 */
export function reflectionTexture(map: ReflectionMap): { texture: CubeTexture; intensity: number } {
  const intensity = Math.max(largest(map), 1e-30) / MOST_HALF;
  // three.js looks cube textures up as if they were seen from outside: along (−x, y, z).
  const images = [1, 0, 2, 3, 4, 5].map((face) => mirrored(map.faces[face]!, map.size, intensity));
  const texture = new CubeTexture(images, CubeReflectionMapping, undefined, undefined, LinearFilter, LinearFilter, RGBAFormat, HalfFloatType);
  texture.colorSpace = LinearSRGBColorSpace;
  texture.generateMipmaps = false;
  texture.needsUpdate = true;
  return { texture, intensity };
}

/** A face with its columns from right to left, in half floats. */
function mirrored(rgb: Float32Array, size: number, unit: number): DataTexture {
  const data = new Uint16Array(4 * size * size);
  for (let row = 0; row < size; row++)
    for (let column = 0; column < size; column++) {
      const from = 3 * (row * size + column), to = 4 * (row * size + size - 1 - column);
      for (let c = 0; c < 3; c++) data[to + c] = DataUtils.toHalfFloat(rgb[from + c]! / unit);
      data[to + 3] = DataUtils.toHalfFloat(1);
    }
  const face = new DataTexture(data, size, size, RGBAFormat, HalfFloatType);
  face.needsUpdate = true;
  return face;
}

/**
 * A surface that is not drawn: it darkens the picture behind it by E_with / E_without, where virtual objects take light
 * from it (differential rendering, Debevec 1998, in ratio form, which needs no albedo). Call {@link ShadowCatcher.update}
 * before every frame.
 */
export class ShadowCatcher extends Mesh<BufferGeometry, MeshLambertMaterial> {
  readonly #scale = { value: new Vector3(1, 1, 1) };

  constructor(geometry: BufferGeometry) {
    super(geometry, new MeshLambertMaterial({ color: 0xffffff, blending: MultiplyBlending, premultipliedAlpha: true, toneMapped: false, depthWrite: false }));
    this.receiveShadow = true;
    this.material.onBeforeCompile = (shader) => {
      shader.uniforms["lightprobeScale"] = this.#scale;
      shader.fragmentShader = `uniform vec3 lightprobeScale;\n${shader.fragmentShader.replace(
        "#include <opaque_fragment>", "outgoingLight = min(outgoingLight * lightprobeScale, vec3(1.0));\n#include <opaque_fragment>")}`;
    };
  }

  /** `light` is all that lights the scene; `normal` that of the surface, in the scene. */
  update(light: ProbeLight, normal: Vec3 = [0, 1, 0]): void {
    const without = light.irradiance(normal);
    // The shader has E / π of a white surface.
    this.#scale.value.fromArray(without.map((value) => (value > 0 ? Math.PI / value : 0)));
  }
}
