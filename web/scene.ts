// SPDX-License-Identifier: Apache-2.0
/** The objects: five materials on a floor, or on the picture of a camera, and what turns the view. */
import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { ShadowCatcher, ambientEnvironment, reflectionTexture } from "../src/three.js";

const RADIUS_M = 0.16, SPACING_M = 0.4, FLOOR_RADIUS_M = 12;

const MATERIALS: Record<string, THREE.Material> = {
  chalk: new THREE.MeshLambertMaterial({ color: 0xf2f0ea }),
  plastic: new THREE.MeshPhysicalMaterial({ color: 0xc0322b, roughness: 0.35, clearcoat: 0.6, clearcoatRoughness: 0.1 }),
  "brushed metal": new THREE.MeshPhysicalMaterial({ color: 0xd7d2c8, metalness: 1, roughness: 0.4, anisotropy: 0.9, anisotropyRotation: Math.PI / 2 }),
  chrome: new THREE.MeshPhysicalMaterial({ color: 0xe6e6e6, metalness: 1, roughness: 0.06 }),
  glass: new THREE.MeshPhysicalMaterial({ color: 0xffffff, roughness: 0.02, transmission: 1, thickness: 2 * RADIUS_M, ior: 1.5 }),
};

export class Stage {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(32, 1, 0.05, 50);
  readonly catcher: ShadowCatcher;
  readonly #floor: THREE.Mesh;
  readonly #objects = new THREE.Group();
  readonly #pmrem: THREE.PMREMGenerator;
  #isPicture = false;
  readonly #environmentMs = new Map<string, number>();
  readonly #environments = new Map<string, { target: THREE.WebGLRenderTarget; intensity: number }>();
  /** Of the view, around the objects. */
  azimuth = 0.35;
  elevation = 0.3;

  constructor(renderer: THREE.WebGLRenderer) {
    this.#pmrem = new THREE.PMREMGenerator(renderer);
    const sphere = new THREE.SphereGeometry(RADIUS_M, 64, 48);
    Object.entries(MATERIALS).forEach(([name, material], i) => {
      const mesh = new THREE.Mesh(sphere, material);
      mesh.name = material.name = name;
      mesh.position.set((i - 2) * SPACING_M, RADIUS_M, i % 2 ? 0.12 : -0.12);
      mesh.castShadow = true;
      mesh.receiveShadow = name === "chalk" || name === "plastic";
      this.#objects.add(mesh);
    });
    const disc = new THREE.CircleGeometry(FLOOR_RADIUS_M, 96).rotateX(-Math.PI / 2);
    this.#floor = new THREE.Mesh(disc, new THREE.MeshLambertMaterial({ color: 0x85807a }));
    this.#floor.receiveShadow = true;
    this.catcher = new ShadowCatcher(new THREE.CircleGeometry(1.4, 64).rotateX(-Math.PI / 2));
    this.catcher.visible = false;
    this.scene.add(this.#objects, this.#floor, this.catcher);
  }

  /** Over the picture of a camera the floor is not drawn, and takes shadows. */
  overPicture(is: boolean): void {
    this.#floor.visible = !is;
    this.catcher.visible = is;
    this.#isPicture = is;
  }

  /** What metal and glass show: the reflection map, or where there is none the ambient light; `who` keeps the probe's and
   * the truth's apart. It is made anew every `periodMs`, because that is the dearest part of a frame. */
  environment(estimate: Estimate | undefined, map: ReflectionMap | undefined, who: string, nowMs: number, periodMs: number): void {
    const known = this.#environments.get(who);
    if (estimate && (!known || nowMs - (this.#environmentMs.get(who) ?? -Infinity) > periodMs)) {
      this.#environments.set(who, map ? this.#ofMap(map) : this.#ofAmbient(estimate));
      known?.target.dispose();
      this.#environmentMs.set(who, nowMs);
    }
    const { target, intensity } = this.#environments.get(who) ?? { target: undefined, intensity: 1 }, texture = target?.texture ?? null;
    if (!this.#isPicture) {
      this.scene.background = texture;
      this.scene.backgroundBlurriness = 0.4;
      this.scene.backgroundIntensity = 0.35 * intensity; // behind, not in front of the objects
    }
    for (const material of Object.values(MATERIALS)) {
      if (material instanceof THREE.MeshPhysicalMaterial && (material.metalness === 1 || material.name === "glass")) Object.assign(material, { envMap: texture, envMapIntensity: intensity });
    }
  }

  #ofMap(map: ReflectionMap): { target: THREE.WebGLRenderTarget; intensity: number } {
    const { texture, intensity } = reflectionTexture(map), target = this.#pmrem.fromCubemap(texture);
    texture.dispose();
    return { target, intensity };
  }

  #ofAmbient(estimate: Estimate): { target: THREE.WebGLRenderTarget; intensity: number } {
    const map = ambientEnvironment(estimate), target = this.#pmrem.fromEquirectangular(map);
    map.dispose();
    return { target, intensity: 1 };
  }

  /** Glass that shows what lies behind it unbent: the bent picture costs a frame of its own. */
  simplifyGlass(): void {
    const glass = MATERIALS["glass"] as THREE.MeshPhysicalMaterial;
    Object.assign(glass, { transmission: 0, transparent: true, opacity: 0.25 });
    glass.needsUpdate = true;
  }

  /** Show a loaded object in place of the spheres; throws what the loader throws. */
  async load(file: File): Promise<void> {
    const { scene } = await new GLTFLoader().parseAsync(await file.arrayBuffer(), "");
    const box = new THREE.Box3().setFromObject(scene), size = box.getSize(new THREE.Vector3());
    scene.scale.multiplyScalar(0.6 / Math.max(size.x, size.y, size.z, 1e-6));
    box.setFromObject(scene);
    const centre = box.getCenter(new THREE.Vector3());
    scene.position.sub(new THREE.Vector3(centre.x, box.min.y, centre.z));
    scene.traverse((one) => { one.castShadow = one.receiveShadow = true; });
    this.#objects.clear();
    this.#objects.add(scene);
  }

  aim(aspect: number): void {
    this.camera.aspect = aspect;
    // All spheres stay in view however narrow it is.
    const halfWidth = 2 * SPACING_M + 2.1 * RADIUS_M;
    const distance = Math.max(2.3, halfWidth / (Math.tan((this.camera.fov * Math.PI) / 360) * aspect));
    this.elevation = Math.min(1.4, Math.max(0.03, this.elevation));
    this.camera.position.setFromSphericalCoords(distance, Math.PI / 2 - this.elevation, this.azimuth);
    this.camera.position.y += RADIUS_M;
    this.camera.lookAt(0, RADIUS_M, 0);
    this.camera.updateProjectionMatrix();
  }
}
