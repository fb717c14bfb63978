// SPDX-License-Identifier: Apache-2.0
/**
 * What the components use of engines that are not installed for building this package. `make test-components` compiles the components against
 * the engines' own types in place of these (tsconfig.engines.json). This file is not part of the package.
 */

declare module "react" {
  export interface ReactElement { readonly type: unknown; readonly props: unknown; readonly key: string | null }
  export function createElement(type: string, props: { object: object }): ReactElement;
  export function useEffect(effect: () => void | (() => void), dependencies?: readonly unknown[]): void;
  export function useState<T>(initial: T): [T, (value: T) => void];
}

declare module "@react-three/fiber" {
  import type { Scene, WebGLRenderer } from "three";
  interface State { gl: WebGLRenderer; scene: Scene }
  export function useFrame(callback: (state: State) => void): unknown;
}

declare module "@babylonjs/core/scene.js" {
  export class Scene {
    useRightHandedSystem: boolean;
    environmentTexture: import("@babylonjs/core/Materials/Textures/rawCubeTexture.js").RawCubeTexture | null;
    readonly onBeforeRenderObservable: { add(callback: () => void): Observer };
    getEngine(): object;
    markAllMaterialsAsDirty(flag: number): void;
  }
  interface Observer { remove(): void }
}

declare module "@babylonjs/core/Maths/math.vector.js" {
  export class Vector3 {
    constructor(x: number, y: number, z: number);
    copyFromFloats(x: number, y: number, z: number): this;
  }
}

declare module "@babylonjs/core/Maths/sphericalPolynomial.js" {
  import type { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
  export class SphericalHarmonics {
    preScaled: boolean;
    l00: Vector3; l1_1: Vector3; l10: Vector3; l11: Vector3; l2_2: Vector3; l2_1: Vector3; l20: Vector3; l21: Vector3; l22: Vector3;
  }
  export class SphericalPolynomial {
    static FromHarmonics(harmonics: SphericalHarmonics): SphericalPolynomial;
    x: Vector3; y: Vector3; z: Vector3; xx: Vector3; yy: Vector3; zz: Vector3; xy: Vector3; yz: Vector3; zx: Vector3;
  }
}

declare module "@babylonjs/core/Lights/directionalLight.js" {
  import type { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
  import type { Scene } from "@babylonjs/core/scene.js";
  export class DirectionalLight {
    constructor(name: string, direction: Vector3, scene: Scene);
    direction: Vector3;
    position: Vector3;
    intensity: number;
    shadowEnabled: boolean;
    shadowFrustumSize: number;
    shadowMinZ: number;
    shadowMaxZ: number;
    diffuse: { set(r: number, g: number, b: number): unknown };
    specular: { set(r: number, g: number, b: number): unknown };
    dispose(): void;
  }
}

declare module "@babylonjs/core/Lights/Shadows/shadowGenerator.js" {
  import type { DirectionalLight } from "@babylonjs/core/Lights/directionalLight.js";
  import type { AbstractMesh } from "@babylonjs/core/Meshes/abstractMesh.js";
  export class ShadowGenerator {
    constructor(mapSize: number, light: DirectionalLight);
    usePercentageCloserFiltering: boolean;
    bias: number;
    normalBias: number;
    addShadowCaster(mesh: AbstractMesh): this;
    getShadowMap(): { refreshRate: number } | null;
    dispose(): void;
  }
}
declare module "@babylonjs/core/Lights/Shadows/shadowGeneratorSceneComponent.js";

declare module "@babylonjs/core/Meshes/abstractMesh.js" {
  export class AbstractMesh { receiveShadows: boolean }
}

declare module "@babylonjs/core/Materials/Textures/baseTexture.polynomial.js";

declare module "@babylonjs/core/Materials/Textures/rawCubeTexture.js" {
  import type { Scene } from "@babylonjs/core/scene.js";
  import type { SphericalPolynomial } from "@babylonjs/core/Maths/sphericalPolynomial.js";
  export class RawCubeTexture {
    constructor(scene: Scene, data: ArrayBufferView[], size: number, format: number, type: number, generateMipMaps: boolean, invertY: boolean, samplingMode: number);
    gammaSpace: boolean;
    sphericalPolynomial: SphericalPolynomial | null;
    dispose(): void;
  }
}

declare module "@babylonjs/core/Materials/Textures/Filtering/hdrFiltering.js" {
  export class HDRFiltering {
    constructor(engine: object);
    prefilter(texture: import("@babylonjs/core/Materials/Textures/rawCubeTexture.js").RawCubeTexture): Promise<void>;
  }
}

declare module "playcanvas" {
  export const ADDRESS_CLAMP_TO_EDGE: number, FILTER_LINEAR: number, PIXELFORMAT_RGBA16F: number;
  export class Vec3 {
    static readonly UP: Vec3;
    set(x: number, y: number, z: number): this;
  }
  export class Quat { setFromDirections(from: Vec3, to: Vec3): this }
  export class Color {
    set(r: number, g: number, b: number): this;
    gamma(): this;
  }
  export class Material { update(): void }
  export class StandardMaterial extends Material { readonly useSkybox: boolean }
  export class LightComponent {
    color: Color;
    castShadows: boolean;
  }
  interface Rendered { meshInstances: { material: Material }[] | null }
  export class Entity {
    constructor(name?: string);
    enabled: boolean;
    readonly light: LightComponent | undefined;
    addComponent(type: "light", options: object): LightComponent | null;
    addChild(child: Entity): void;
    findComponents(type: "render" | "model"): Rendered[];
    setRotation(rotation: Quat): void;
    destroy(): void;
  }
  export class GraphicsDevice { readonly maxTextureSize: number }
  export class Texture {
    constructor(device: GraphicsDevice, options: object);
    destroy(): void;
  }
  export class EnvLighting {
    static generateLightingSource(source: Texture, options: { size: number }): Texture;
    static generateAtlas(source: Texture, options: { numReflectionSamples: number; numAmbientSamples: number }): Texture;
  }
  export class AppBase {
    readonly root: Entity;
    readonly graphicsDevice: GraphicsDevice;
    readonly scene: { envAtlas: Texture | null };
    on(name: "update", callback: () => void): unknown;
    off(name: "update", callback: () => void): unknown;
  }
}
