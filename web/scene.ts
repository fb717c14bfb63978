// SPDX-License-Identifier: Apache-2.0
/** The objects: spheres of several materials on a floor, or on the picture of a camera, and what turns the view. */
import * as THREE from "three";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { ShadowCatcher } from "../src/three.js";
import { BY_FORMULA, DIAMETER_M, MIRRORS, NAMES, PHYSICAL, mirroringOnly } from "./materials.js";
import { Surroundings } from "./surroundings.js";

const RADIUS_M = DIAMETER_M / 2, SPACING_M = 0.4, FLOOR_RADIUS_M = 12, FIELD_DEG = 32;

export class Stage {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(FIELD_DEG, 1, 0.05, 50);
  readonly catcher: ShadowCatcher;
  readonly #floor: THREE.Mesh;
  readonly #objects = new THREE.Group();
  readonly #spheres: THREE.Mesh<THREE.BufferGeometry, THREE.Material>[] = [];
  readonly #surroundings: Record<"probe" | "truth", Surroundings>;
  /** Of the loaded object, what mirrors its surroundings. */
  #loaded: THREE.MeshStandardMaterial[] = [];
  #isPicture = false;
  #marked: THREE.Matrix4 | undefined;
  /** Of the view, around the objects. */
  azimuth = 0.35;
  elevation = 0.3;

  constructor(renderer: THREE.WebGLRenderer) {
    this.#surroundings = { probe: new Surroundings(renderer), truth: new Surroundings(renderer) };
    const sphere = new THREE.SphereGeometry(RADIUS_M, 64, 48);
    NAMES.forEach((name, i) => {
      const mesh = new THREE.Mesh<THREE.BufferGeometry, THREE.Material>(sphere, PHYSICAL[name]);
      mesh.name = name;
      mesh.position.set((i - (NAMES.length - 1) / 2) * SPACING_M, RADIUS_M, i % 2 ? 0.12 : -0.12);
      mesh.castShadow = true;
      mesh.receiveShadow = name === "chalk" || name === "plastic";
      this.#spheres.push(mesh);
    });
    this.#objects.add(...this.#spheres);
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

  /** Materials by the formulas of lightprobe.shading, or three.js' physical ones. */
  useFormulas(are: boolean): void {
    for (const mesh of this.#spheres) mesh.material = (are ? BY_FORMULA : PHYSICAL)[mesh.name as (typeof NAMES)[number]];
  }

  /** What metal and glass show in the light of the probe or of the truth, made anew every `periodMs`. */
  environment(estimate: Estimate | undefined, map: ReflectionMap | undefined, who: "probe" | "truth", nowMs: number, periodMs: number): void {
    const surroundings = this.#surroundings[who];
    surroundings.update(estimate, map, nowMs, periodMs);
    const { texture, intensity, cube } = surroundings;
    if (!this.#isPicture) {
      this.scene.background = texture;
      this.scene.backgroundBlurriness = 0.4;
      this.scene.backgroundIntensity = 0.35 * intensity; // behind, not in front of the objects
    }
    for (const material of [...MIRRORS, ...this.#loaded]) Object.assign(material, { envMap: texture, envMapIntensity: intensity });
    for (const material of Object.values(BY_FORMULA)) material.setSurroundings(cube);
  }

  /** Glass that shows what lies behind it unbent: the bent picture costs a frame of its own. */
  simplifyGlass(): void {
    Object.assign(PHYSICAL.glass, { transmission: 0, transparent: true, opacity: 0.25 });
    PHYSICAL.glass.needsUpdate = true;
  }

  /** Show a loaded object in place of the spheres; throws what the loader throws. */
  async load(file: File): Promise<void> {
    const { scene } = await new GLTFLoader().parseAsync(await file.arrayBuffer(), "");
    const box = new THREE.Box3().setFromObject(scene), size = box.getSize(new THREE.Vector3());
    scene.scale.multiplyScalar(0.6 / Math.max(size.x, size.y, size.z, 1e-6));
    box.setFromObject(scene);
    const centre = box.getCenter(new THREE.Vector3());
    scene.position.sub(new THREE.Vector3(centre.x, box.min.y, centre.z));
    const materials = new Set<THREE.Material>();
    scene.traverse((one) => {
      one.castShadow = one.receiveShadow = true;
      if (one instanceof THREE.Mesh) for (const material of [one.material].flat() as THREE.Material[]) materials.add(material);
    });
    this.#loaded = [...materials].filter((material) => material instanceof THREE.MeshStandardMaterial).map(mirroringOnly);
    this.#objects.clear();
    this.#objects.add(scene);
  }

  /** The ground as an AR camera sees it, which the classic formulas mirror; undefined: none. */
  setGround(ground: { texture: THREE.Texture; sideM: number; gain: number } | undefined): void {
    for (const material of Object.values(BY_FORMULA)) material.setGround(ground);
  }

  /** The view is that of a camera in the scene, of such a vertical field, until it is undefined. */
  lookFrom(place: THREE.Matrix4 | undefined, fieldDeg = FIELD_DEG): void {
    this.#marked = place;
    this.camera.fov = place ? fieldDeg : FIELD_DEG;
  }

  aim(aspect: number): void {
    this.camera.aspect = aspect;
    if (this.#marked) {
      this.#marked.decompose(this.camera.position, this.camera.quaternion, this.camera.scale);
      this.camera.updateProjectionMatrix();
      return;
    }
    // All spheres stay in view however narrow it is.
    const halfWidth = ((NAMES.length - 1) / 2) * SPACING_M + 2.1 * RADIUS_M;
    const distance = Math.max(2.3, halfWidth / (Math.tan((this.camera.fov * Math.PI) / 360) * aspect));
    this.elevation = Math.min(1.4, Math.max(0.03, this.elevation));
    this.camera.position.setFromSphericalCoords(distance, Math.PI / 2 - this.elevation, this.azimuth);
    this.camera.position.y += RADIUS_M;
    this.camera.lookAt(0, RADIUS_M, 0);
    this.camera.updateProjectionMatrix();
  }
}
