// SPDX-License-Identifier: Apache-2.0
/** The objects: a still life, spheres of several materials or a loaded object, on a round table or on the picture of a camera; and what turns the view. */
import * as THREE from "three";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { ShadowCatcher } from "../src/three.js";
import { dispose } from "./disposed.js";
import { BY_FORMULA, DIAMETER_M, MIRRORS, PHYSICAL, SPHERES, SURFACES, mirroringOnly } from "./materials.js";
import { loadedObject } from "./object.js";
import { STILL_LIFE_HALF_M, stillLife, type Piece } from "./still_life.js";
import type { Surface } from "./surface.js";
import { Surroundings } from "./surroundings.js";
import { withTerm, type Term, type TermSettings } from "./terms.js";

const RADIUS_M = DIAMETER_M / 2, SPACING_M = 0.4, FIELD_DEG = 32;
const SPHERES_HALF_M = ((SPHERES.length - 1) / 2) * SPACING_M + RADIUS_M;
/** Of a loaded object. */
const LONGEST_SIDE_M = 0.6;
const LEAST_DISTANCE_M = 1.7;
/** The table is so much wider than what stands on it, and its edge so thick. */
const TABLE_WIDER = 1.3, EDGE_M = 0.03;
const LEAST_ZOOM = 0.35, MOST_ZOOM = 2;
/** How bright and how blurred the room is behind the objects. */
const BEHIND_INTENSITY = 0.85, BEHIND_BLURRINESS = 0.12;

/** What stands there: what is made here, or a loaded object. */
export type What = "still life" | "spheres" | "loaded";
/** What is behind it; the picture of a camera is neither. */
export type Behind = "room" | "plain";

function spheres(): THREE.Group {
  const group = new THREE.Group(), sphere = new THREE.SphereGeometry(RADIUS_M, 64, 48);
  SPHERES.forEach((name, i) => {
    const mesh = new THREE.Mesh<THREE.BufferGeometry, THREE.Material>(sphere, PHYSICAL[name]);
    mesh.name = name;
    mesh.position.set((i - (SPHERES.length - 1) / 2) * SPACING_M, RADIUS_M, i % 2 ? 0.12 : -0.12);
    mesh.castShadow = true;
    mesh.receiveShadow = name === "chalk" || name === "plastic";
    group.add(mesh);
  });
  return group;
}

/** A round plate of radius 1 whose surface is y = 0, with a rounded edge. */
function table(): THREE.Mesh {
  const edge = Array.from({ length: 9 }, (_, i) => new THREE.Vector2(1 - (EDGE_M / 2) * (1 - Math.cos((Math.PI * (i - 4)) / 8)), (EDGE_M / 2) * (Math.sin((Math.PI * (i - 4)) / 8) - 1)));
  const outline = [new THREE.Vector2(0, -EDGE_M), ...edge, new THREE.Vector2(0.5, 0), new THREE.Vector2(0, 0)];
  const mesh = new THREE.Mesh(new THREE.LatheGeometry(outline, 128), new THREE.MeshLambertMaterial({ color: 0xbdb8b0 }));
  mesh.receiveShadow = true;
  return mesh;
}

export class Stage {
  readonly scene = new THREE.Scene();
  readonly camera = new THREE.PerspectiveCamera(FIELD_DEG, 1, 0.05, 50);
  readonly catcher: ShadowCatcher;
  readonly #table = table();
  readonly #objects = new THREE.Group();
  readonly #made: Record<Exclude<What, "loaded">, THREE.Group>;
  readonly #surroundings: Record<"probe" | "other", Surroundings>;
  #halfM = STILL_LIFE_HALF_M;
  #loadedObject: THREE.Object3D | undefined;
  /** Of the loaded object, what mirrors its surroundings. */
  #loaded: THREE.MeshStandardMaterial[] = [];
  #isPicture = false;
  #marked: THREE.Matrix4 | undefined;
  behind: Behind = "room";
  /** Of the view, around the objects. */
  azimuth = 0.35;
  elevation = 0.3;
  /** Of the distance that shows everything: nearer, or further away. */
  zoom = 1;

  constructor(renderer: THREE.WebGLRenderer) {
    this.#surroundings = { probe: new Surroundings(renderer), other: new Surroundings(renderer) };
    this.#made = { "still life": stillLife(), spheres: spheres() };
    this.catcher = new ShadowCatcher(new THREE.CircleGeometry(1.4, 64).rotateX(-Math.PI / 2));
    this.catcher.visible = false;
    this.scene.add(this.#objects, this.#table, this.catcher);
    this.show("still life");
  }

  /** A loaded object can be shown once there is one. */
  show(what: What): void {
    const shown = what === "loaded" ? this.#loadedObject : this.#made[what];
    if (!shown) return;
    this.#objects.clear();
    this.#objects.add(shown);
    this.#halfM = { "still life": STILL_LIFE_HALF_M, spheres: SPHERES_HALF_M, loaded: LONGEST_SIDE_M }[what];
    this.#table.scale.set(TABLE_WIDER * this.#halfM, 1, TABLE_WIDER * this.#halfM);
  }

  /** Over the picture of a camera the floor is not drawn, and takes shadows. */
  overPicture(is: boolean): void {
    this.#table.visible = !is;
    this.catcher.visible = is;
    this.#isPicture = is;
  }

  /** Materials by the formulas of lightprobe.shading, or three.js' physical ones. */
  useFormulas(are: boolean): void {
    for (const group of Object.values(this.#made))
      group.traverse((one) => { if (one instanceof THREE.Mesh) one.material = (are ? BY_FORMULA : PHYSICAL)[one.name as Piece]; });
  }

  /** What the formulas are given, for each material. */
  setTerm(term: Term, settings: TermSettings): void {
    for (const [name, surface] of Object.entries<Surface>(SURFACES)) BY_FORMULA[name as Piece].set(withTerm(surface, term, settings));
  }

  /** What metal and glass show in the light of the probe or of what is compared with it, made anew every `periodMs`. */
  environment(estimate: Estimate | undefined, map: ReflectionMap | undefined, who: "probe" | "other", nowMs: number, periodMs: number): void {
    const surroundings = this.#surroundings[who];
    surroundings.update(estimate, map, nowMs, periodMs);
    const { texture, intensity, cube } = surroundings;
    if (!this.#isPicture) {
      this.scene.background = this.behind === "room" ? texture : null;
      this.scene.backgroundBlurriness = BEHIND_BLURRINESS;
      this.scene.backgroundIntensity = BEHIND_INTENSITY * intensity;
    }
    for (const material of [...MIRRORS, ...this.#loaded]) Object.assign(material, { envMap: texture, envMapIntensity: intensity });
    for (const material of Object.values(BY_FORMULA)) material.setSurroundings(cube);
  }

  /** Glass that shows what lies behind it unbent: the bent picture costs a frame of its own. */
  simplifyGlass(): void {
    for (const glass of [PHYSICAL.glass, PHYSICAL.goblet]) {
      Object.assign(glass, { transmission: 0, transparent: true, opacity: 0.25 });
      glass.needsUpdate = true;
    }
  }

  /** Show an object of a file; throws what the loader throws, and what keeps the page from it. */
  async load(file: File): Promise<void> {
    const scene = await loadedObject(file);
    const box = new THREE.Box3().setFromObject(scene), size = box.getSize(new THREE.Vector3());
    scene.scale.multiplyScalar(LONGEST_SIDE_M / Math.max(size.x, size.y, size.z, 1e-6));
    box.setFromObject(scene);
    const centre = box.getCenter(new THREE.Vector3());
    scene.position.sub(new THREE.Vector3(centre.x, box.min.y, centre.z));
    const materials = new Set<THREE.Material>();
    scene.traverse((one) => {
      one.castShadow = one.receiveShadow = true;
      if (one instanceof THREE.Mesh) for (const material of [one.material].flat() as THREE.Material[]) materials.add(material);
    });
    this.#loaded = [...materials].filter((material) => material instanceof THREE.MeshStandardMaterial).map(mirroringOnly);
    const former = this.#loadedObject;
    this.#loadedObject = scene;
    this.show("loaded");
    if (former) dispose(former);
  }

  /** By so many steps; below 0: further away. */
  nearer(steps: number): void {
    this.zoom = Math.min(MOST_ZOOM, Math.max(LEAST_ZOOM, this.zoom * 0.9 ** steps));
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
    // Everything stays in view however narrow it is.
    const across = Math.tan((this.camera.fov * Math.PI) / 360) * Math.min(1, aspect);
    const distance = this.zoom * Math.max(LEAST_DISTANCE_M, (1.08 * this.#halfM) / across);
    this.elevation = Math.min(1.4, Math.max(0.03, this.elevation));
    this.camera.position.setFromSphericalCoords(distance, Math.PI / 2 - this.elevation, this.azimuth);
    this.camera.position.y += RADIUS_M;
    this.camera.lookAt(0, RADIUS_M, 0);
    this.camera.updateProjectionMatrix();
  }
}
