// SPDX-License-Identifier: Apache-2.0
/** For three.js: a group that lights the scene with a probe's light. Several lamps, soft shadows, no jumps. */

import { CubeReflectionMapping, CubeTexture, DataTexture, DataUtils, DirectionalLight, EquirectangularReflectionMapping, FloatType, Group, HalfFloatType, LightProbe, Mesh, MeshLambertMaterial, MultiplyBlending, LinearFilter, LinearSRGBColorSpace, Quaternion, RGBAFormat, Vector3 } from "three";
import type { BufferGeometry, Object3DEventMap } from "three";
import { besideSh, fallbackEstimate, LightFlag } from "./estimate.js";
import type { Estimate, Light, Vec3 } from "./estimate.js";
import { largest, type ReflectionMap } from "./reflection.js";
import * as sh from "./sh.js";

export interface ProbeLightOptions {
  /** Lamps at once. Their number is fixed, because three.js compiles its shaders for it. */
  lamps?: number;
  /** Time constant of changes, in seconds. */
  fadeS?: number;
  /** What to show before the first and after the last estimate, given the last; default: fallbackEstimate. */
  fallback?: (last: Estimate | undefined) => Estimate;
  castShadow?: boolean;
  shadowMapSize?: number;
  /** Half the width of the region with shadows, in metres. */
  shadowRegionM?: number;
  /** Height of what casts shadows, in metres: a shadow's edge is as wide as 2 height tan(angular radius). */
  shadowHeightM?: number;
}

interface Slot {
  light: DirectionalLight;
  /** Of the lamp that it shows, with the boot; undefined: free. */
  key: string | undefined;
  direction: Vector3;
  irradiance: Vector3;
  radiusDeg: number;
  target: { direction: Vector3; irradiance: Vector3; radiusDeg: number };
}

const DARK = 1e-4;
/** After a pause of the page a fade goes on from where it was: one step is never longer. */
const MOST_STEP_S = 0.1;

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

  readonly #slots: Slot[] = [];
  readonly #options: Required<ProbeLightOptions>;
  #coefficients: number[] = Array.from({ length: 27 }, () => 0);
  readonly #normal = new Vector3();
  #lastS: number | undefined;
  #isLit = false;
  #last: Estimate | undefined;
  #fallback: Estimate | undefined;

  constructor(options: ProbeLightOptions = {}) {
    super();
    this.#options = {
      lamps: 4, fadeS: 0.15, castShadow: true, shadowMapSize: 1024, shadowRegionM: 1.5, shadowHeightM: 0.3,
      fallback: fallbackEstimate, ...options,
    };
    this.add(this.ambient);
    for (let i = 0; i < this.#options.lamps; i++) this.#slots.push(this.#makeSlot());
  }

  /** The directional lights, shown or not. */
  get lamps(): readonly DirectionalLight[] {
    return this.#slots.map((slot) => slot.light);
  }

  /** Move on towards an estimate (undefined: the fallback) by the time that has passed; `timeS` of any clock. */
  update(estimate: Estimate | undefined, timeS: number): void {
    if (this.#lastS === undefined && !estimate && !this.#last) this.set(undefined); // nothing was shown that it could fade from
    const passedS = this.#lastS === undefined ? 0 : Math.min(MOST_STEP_S, Math.max(0, timeS - this.#lastS));
    this.#lastS = timeS;
    this.#step(estimate, 1 - Math.exp(-passedS / this.#options.fadeS));
  }

  #step(known: Estimate | undefined, share: number): void {
    const estimate = known ?? (this.#fallback ??= this.#options.fallback(this.#last));
    if (known) [this.#last, this.#fallback] = [known, undefined];
    if (this.#isLit !== (known !== undefined)) {
      this.#isLit = !this.#isLit;
      this.dispatchEvent({ type: this.#isLit ? "estimationstart" : "estimationend" });
    }
    this.#aim(estimate);
    for (const slot of this.#slots) this.#move(slot, share);
    const coefficients = this.#turned(estimate);
    this.#coefficients = this.#coefficients.map((value, i) => value + share * ((coefficients[i] ?? 0) - value));
    this.ambient.sh.fromArray(this.#coefficients);
  }

  /** Irradiance of what is shown now on a surface with this normal, both in the scene's axes. */
  irradiance(normal: Vec3): [number, number, number] {
    const sum = sh.irradiance(this.#coefficients, normal);
    for (const { direction, irradiance } of this.#slots) {
      const cosine = Math.max(0, direction.dot(this.#normal.set(...normal)));
      irradiance.toArray().forEach((value, c) => { sum[c]! += cosine * value; });
    }
    return sum;
  }

  /** Show an estimate at once; undefined: the fallback. */
  set(estimate: Estimate | undefined): void {
    this.#step(estimate, 1);
    this.#lastS = undefined;
  }

  /** For slower machines. */
  setShadowMapSize(pixels: number): void {
    this.#options.shadowMapSize = pixels;
    for (const { light } of this.#slots) {
      light.shadow.mapSize.set(pixels, pixels);
      light.shadow.map?.dispose();
      light.shadow.map = null;
    }
  }

  override dispose(): void {
    for (const slot of this.#slots) slot.light.dispose();
  }

  #makeSlot(): Slot {
    const light = new DirectionalLight(0xffffff, 0);
    const { castShadow, shadowMapSize, shadowRegionM } = this.#options;
    light.castShadow = castShadow;
    light.shadow.mapSize.set(shadowMapSize, shadowMapSize);
    Object.assign(light.shadow.camera, { left: -shadowRegionM, right: shadowRegionM, top: shadowRegionM, bottom: -shadowRegionM, near: 0.1, far: 20 });
    light.shadow.normalBias = 0.01;
    this.add(light, light.target);
    const direction = new Vector3(0, 1, 0);
    return {
      light, key: undefined, direction, irradiance: new Vector3(), radiusDeg: 1,
      target: { direction: direction.clone(), irradiance: new Vector3(), radiusDeg: 1 },
    };
  }

  /** Which slot shows which lamp, and what it is on its way to. A lamp keeps its slot while it lasts. */
  #aim(estimate: Estimate): void {
    const lights = besideSh(estimate).slice(0, this.#slots.length);
    const wanted = new Map(lights.map((light) => [`${estimate.bootId}/${light.id}`, light]));
    for (const slot of this.#slots) {
      const light = slot.key === undefined ? undefined : wanted.get(slot.key);
      if (light) {
        this.#setTarget(slot, light);
        wanted.delete(slot.key!);
      } else {
        slot.target.irradiance.set(0, 0, 0);
        if (slot.irradiance.length() < DARK || slot.key === undefined) slot.key = undefined;
      }
    }
    for (const [key, light] of wanted) {
      const slot = this.#slots.find((one) => one.key === undefined) ?? this.#darkest(new Set(lights.map((one) => `${estimate.bootId}/${one.id}`)));
      if (!slot) continue;
      slot.key = key;
      this.#setTarget(slot, light);
      slot.direction.copy(slot.target.direction); // a new lamp begins where it is, dark
      slot.irradiance.set(0, 0, 0);
      slot.radiusDeg = slot.target.radiusDeg;
    }
  }

  /** Of the slots whose lamp has gone and still fades, the one that is nearest to its end. */
  #darkest(present: Set<string>): Slot | undefined {
    return this.#slots.filter((slot) => !present.has(slot.key ?? "")).sort((a, b) => a.irradiance.length() - b.irradiance.length())[0];
  }

  #setTarget(slot: Slot, light: Light): void {
    slot.target.direction.set(...light.direction).applyQuaternion(this.toProbe.clone().invert());
    slot.target.irradiance.set(...light.irradiance);
    slot.target.radiusDeg = light.angularRadiusDeg;
    slot.light.castShadow = this.#options.castShadow && !(light.flags & LightFlag.REFLECTION);
  }

  #move(slot: Slot, share: number): void {
    const { light, target } = slot;
    slot.irradiance.lerp(target.irradiance, share);
    slot.direction.lerp(target.direction, share);
    if (slot.direction.lengthSq() < 1e-6) slot.direction.copy(target.direction); // opposite: no way between
    slot.direction.normalize();
    slot.radiusDeg += share * (target.radiusDeg - slot.radiusDeg);
    const strength = Math.max(slot.irradiance.x, slot.irradiance.y, slot.irradiance.z);
    light.intensity = strength;
    light.shadow.autoUpdate = strength > 0; // the shadow of no light is not drawn
    if (strength > 0) light.color.setRGB(slot.irradiance.x / strength, slot.irradiance.y / strength, slot.irradiance.z / strength, LinearSRGBColorSpace);
    light.position.copy(slot.direction).multiplyScalar(10).add(light.target.position);
    const { shadowHeightM, shadowRegionM, shadowMapSize } = this.#options;
    const penumbraM = 2 * shadowHeightM * Math.tan((Math.min(slot.radiusDeg, 40) * Math.PI) / 180);
    light.shadow.radius = Math.max(1, ((penumbraM / 2) * shadowMapSize) / (2 * shadowRegionM));
  }

  #turned(estimate: Estimate): number[] {
    const vector = new Vector3();
    return sh.rotate(estimate.sh.coefficients, (d) => vector.set(...d).applyQuaternion(this.toProbe).toArray() as unknown as Vec3);
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
