// SPDX-License-Identifier: Apache-2.0
/** For Babylon.js: lights a scene of PBR materials. */

import { DirectionalLight } from "@babylonjs/core/Lights/directionalLight.js";
import { ShadowGenerator } from "@babylonjs/core/Lights/Shadows/shadowGenerator.js";
import "@babylonjs/core/Lights/Shadows/shadowGeneratorSceneComponent.js";
import "@babylonjs/core/Materials/Textures/baseTexture.polynomial.js";
import { HDRFiltering } from "@babylonjs/core/Materials/Textures/Filtering/hdrFiltering.js";
import { RawCubeTexture } from "@babylonjs/core/Materials/Textures/rawCubeTexture.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { SphericalHarmonics, SphericalPolynomial } from "@babylonjs/core/Maths/sphericalPolynomial.js";
import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
import type { Scene } from "@babylonjs/core/scene.js";
import type { Probe } from "./client.js";
import { cubeTexels } from "./cube.js";
import type { Vec3 } from "./estimate.js";
import { Feed, type FeedOptions } from "./feed.js";
import type { Slot } from "./fading.js";
import { coarseMap, mirroredMap, type SceneMap } from "./scene_map.js";
import type { ShownLight } from "./shown_light.js";
import * as sh from "./sh.js";

export type ProbeLightOptions = FeedOptions;

/** Babylon's Constants: RGBA, half floats, linear between texels and mipmaps, textures of materials have changed, draw a shadow map once or in every frame. */
const RGBA = 5, HALF_FLOAT = 2, TRILINEAR = 3, TEXTURES = 1, ONCE = 0, EVERY_FRAME = 1;

interface Lamp {
  light: DirectionalLight;
  shadow: ShadowGenerator | undefined;
}

/**
 * Lamps are directional lights. The rest of the light and reflections are `scene.environmentTexture`: PBR materials have both, StandardMaterials lamps
 * alone, π times too bright. A material takes `maxSimultaneousLights` lamps, 4 by default, as many as the option `lamps` has.
 * @example
 * const light = new ProbeLight(scene, { url: "ws://127.0.0.1:7701/" });
 * light.addShadowCaster(ball);
 * floor.receiveShadows = true;
 */
export class ProbeLight {
  readonly #scene: Scene;
  readonly #feed: Feed;
  readonly #lamps: Lamp[];
  readonly #filter: HDRFiltering;
  readonly #observer: { remove(): void };
  #environment: RawCubeTexture;
  #isFiltering = false;
  #isDisposed = false;

  /** Connects, and moves on before every frame of the scene; throws what Probe does. */
  constructor(scene: Scene, options: ProbeLightOptions = {}) {
    this.#scene = scene;
    this.#feed = new Feed(options);
    this.#lamps = Array.from({ length: this.shown.lamps }, (_, i) => lampOf(scene, i, options));
    this.#filter = new HDRFiltering(scene.getEngine() as ConstructorParameters<typeof HDRFiltering>[0]);
    this.#environment = textureOf(scene, { map: coarseMap(new Float32Array(27), 1), gain: 1 }); // black: the ambient light is its polynomial
    scene.environmentTexture = this.#environment;
    this.#observer = scene.onBeforeRenderObservable.add(() => this.#frame());
  }

  get probe(): Probe {
    return this.#feed.probe;
  }

  /** What is shown, in right-handed axes, −Z forward: `strength` and `neutral` may be set. */
  get shown(): ShownLight {
    return this.#feed.light;
  }

  /** The directional lights, shown or not. */
  get lamps(): readonly DirectionalLight[] {
    return this.#lamps.map(({ light }) => light);
  }

  /** Show the light of a place: x, y, z in metres from the probe, axes of the scene; undefined: where the probe is. */
  at(positionM: Vec3 | undefined): void {
    this.#feed.at(positionM && [positionM[0], positionM[1], this.#forward * positionM[2]]);
  }

  /** The mesh casts a shadow of every lamp on meshes with `receiveShadows`. */
  addShadowCaster(mesh: AbstractMesh): void {
    for (const { shadow } of this.#lamps) shadow?.addShadowCaster(mesh);
  }

  /** Ends its own connection, and takes its lights and its environment out of the scene. */
  dispose(): void {
    this.#isDisposed = true;
    this.#observer.remove();
    this.#feed.close();
    for (const { light, shadow } of this.#lamps) {
      shadow?.dispose();
      light.dispose();
    }
    if (this.#scene.environmentTexture === this.#environment) this.#scene.environmentTexture = null;
    this.#environment.dispose();
  }

  /** Sign of z in the scene. */
  get #forward(): 1 | -1 {
    return this.#scene.useRightHandedSystem ? 1 : -1;
  }

  #frame(): void {
    this.shown.update(this.probe.latest(), performance.now() / 1000);
    this.#lamps.forEach((lamp, i) => aim(lamp, this.shown.slots[i], this.#forward));
    this.#environment.sphericalPolynomial = polynomialOf(this.shown.coefficients);
    const map = this.#isFiltering ? undefined : this.#feed.changedMap();
    if (map) void this.#mirror(map);
  }

  /** Blurs a map for rough materials, and puts it in place of the one before. */
  async #mirror(map: SceneMap): Promise<void> {
    this.#isFiltering = true;
    const texture = textureOf(this.#scene, map), before = this.#environment;
    try {
      await this.#filter.prefilter(texture);
      this.#isFiltering = false; // a graphics card that cannot blur is not asked again: reflections stay as they are
    } catch (error) {
      console.warn("lightprobe: reflections are not shown: their map cannot be blurred", error);
      texture.dispose();
      return;
    }
    if (this.#isDisposed) {
      texture.dispose();
      return;
    }
    texture.sphericalPolynomial = polynomialOf(this.shown.coefficients);
    this.#environment = texture;
    if (this.#scene.environmentTexture === before) this.#scene.environmentTexture = texture;
    before.dispose();
    this.#scene.markAllMaterialsAsDirty(TEXTURES);
  }
}

function lampOf(scene: Scene, i: number, { castShadow = true, shadowMapSize = 1024, shadowRegionM = 1.5 }: FeedOptions): Lamp {
  const light = new DirectionalLight(`lightprobe ${i}`, new Vector3(0, -1, 0), scene);
  light.intensity = 0;
  if (!castShadow) return { light, shadow: undefined };
  Object.assign(light, { shadowFrustumSize: 2 * shadowRegionM, shadowMinZ: 0.1, shadowMaxZ: 20 });
  const shadow = new ShadowGenerator(shadowMapSize, light);
  Object.assign(shadow, { usePercentageCloserFiltering: true, bias: 0.001, normalBias: 0.01 });
  return { light, shadow };
}

/** Makes a light what its slot shows; undefined: none has been needed yet. */
function aim({ light, shadow }: Lamp, slot: Slot | undefined, forward: number): void {
  const [r, g, b] = slot?.irradiance ?? [0, 0, 0], strength = Math.max(r, g, b);
  light.intensity = strength;
  const drawn = shadow?.getShadowMap();
  if (drawn && (drawn.refreshRate === EVERY_FRAME) !== strength > 0) drawn.refreshRate = strength > 0 ? EVERY_FRAME : ONCE; // the shadow of no light is not drawn
  if (!slot || strength === 0) return;
  for (const colour of [light.diffuse, light.specular]) colour.set(r / strength, g / strength, b / strength);
  const [x, y, z] = slot.direction;
  light.direction.copyFromFloats(-x, -y, -forward * z);
  light.position.copyFromFloats(10 * x, 10 * y, 10 * forward * z);
  light.shadowEnabled = !slot.isReflection;
}

/** Environments are in left-handed axes, whatever the scene is. */
function textureOf(scene: Scene, { map, gain }: Pick<SceneMap, "map" | "gain">): RawCubeTexture {
  const { faces, size } = cubeTexels(mirroredMap(map, 2), "rgba16f", gain);
  const texture = new RawCubeTexture(scene, faces, size, RGBA, HALF_FLOAT, true, false, TRILINEAR);
  texture.gammaSpace = false;
  return texture;
}

/**
 * E / π for a normal in left-handed axes, in both of the forms that Babylon's shaders read. Babylon's own conversions from harmonics to
 * polynomials leave one of the two without the cosine lobe, so both are set.
 */
function polynomialOf(coefficients: ArrayLike<number>): SphericalPolynomial {
  const { one, x, y, z, xy, yz, zx, zz, xx } = sh.polynomial(coefficients);
  const sum = (of: (c: number) => number): Vector3 => new Vector3(of(0), of(1), of(2));
  const first = { x: sum((c) => x[c]!), y: sum((c) => y[c]!), z: sum((c) => -z[c]!) }, second = { xy: sum((c) => xy[c]!), yz: sum((c) => -yz[c]!), zx: sum((c) => -zx[c]!) };
  const harmonics = Object.assign(new SphericalHarmonics(), {
    preScaled: true, l00: sum((c) => one[c]!), l1_1: first.y, l10: first.z, l11: first.x, l2_2: second.xy, l2_1: second.yz, l20: sum((c) => zz[c]!), l21: second.zx, l22: sum((c) => xx[c]!),
  });
  return Object.assign(SphericalPolynomial.FromHarmonics(harmonics), first, second, {
    xx: sum((c) => one[c]! - zz[c]! + xx[c]!), yy: sum((c) => one[c]! - zz[c]! - xx[c]!), zz: sum((c) => one[c]! + 2 * zz[c]!), // 1 = x² + y² + z²
  });
}
