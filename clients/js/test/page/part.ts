// SPDX-License-Identifier: Apache-2.0
/** What the pages of the components have in common: test/components.ts opens them. A ball of radius 1 at the origin, above a floor. */
import type * as Three from "three";
import type { Estimate, Probe, Vec3 } from "../../src/index.js";
import { irradiance } from "../../src/index.js";
import type { ShownLight } from "../../src/shown_light.js";
import { pictureSize, readBall, type BallSample, type Numbers3 } from "./xr_ball.js";

const hash = new URLSearchParams(location.hash.slice(1));

/** Of the component, as the page's address has them. */
export const options = { url: hash.get("url") ?? "", exposure: Number(hash.get("exposure") ?? 1), reflections: hash.get("reflections") === "true", strength: Number(hash.get("strength") ?? 1) };
export const isRightHanded = hash.get("right") !== null;

/** The floor, and half the width of a picture of it from above. */
export const FLOOR_Y = -1.2, FLOOR_HALF = 2;
/** x and z of a place in the shadow of a lamp at (0, 1, −1), and of one that is not. */
const SPOTS = { shadow: [0, 1.3], open: [1.7, -1.5] } as const;

/** Where the spots are in a picture from above, rows from below. */
export function spotsOf(rgba: ArrayLike<number>): Record<"shadow" | "open", Numbers3> {
  const pixel = (value: number): number => Math.floor(((value / FLOOR_HALF + 1) / 2) * pictureSize);
  const colour = ([x, z]: readonly [number, number]): Numbers3 => {
    const at = 4 * (pixel(-z) * pictureSize + pixel(x));
    return [rgba[at]!, rgba[at + 1]!, rgba[at + 2]!];
  };
  return { shadow: colour(SPOTS.shadow), open: colour(SPOTS.open) };
}

const NORMALS: Vec3[] = Array.from({ length: 30 }, (_, i) => {
  const y = 1 - (2 * (i + 0.5)) / 30, radius = Math.sqrt(1 - y * y);
  return [radius * Math.cos(i * 2.399963), y, radius * Math.sin(i * 2.399963)];
});

/** The component shows the newest packet, and no longer fades. */
export function settled({ shown, probe }: { shown: ShownLight; probe: Probe }): boolean {
  const estimate = probe.latest();
  if (!estimate) return false;
  const most = Math.max(...irradiance(estimate, [0, 1, 0]), ...irradiance(estimate, [0, -1, 0]));
  return NORMALS.every((n) => irradiance(estimate, n).every((value, c) => Math.abs(shown.irradiance(n)[c]! - shown.gain * value) < 1e-3 * shown.gain * most));
}

export interface ThreePart {
  THREE: typeof Three;
  renderer: Three.WebGLRenderer;
  scene: Three.Scene;
  ball: Three.Mesh;
  floor: Three.Mesh;
  light: { shown: ShownLight; probe: Probe; lamps: readonly Three.DirectionalLight[] };
}

/** Functions of a page of three.js for the tests; `part` is undefined until the page is there. */
export function serveThree(part: () => ThreePart | undefined): void {
  const radiance = (kind: "lambert" | "standard" | "mirror"): BallSample[] => {
    const { THREE, renderer, scene, ball, floor, light } = part()!;
    const materials = {
      lambert: () => new THREE.MeshLambertMaterial({ color: 0xffffff }),
      standard: () => new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: 1, metalness: 0 }),
      mirror: () => new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: 0, metalness: 1 }),
    };
    ball.material = materials[kind]();
    floor.visible = false;
    for (const lamp of light.lamps) lamp.visible = kind !== "mirror";
    const samples = readBall(THREE, renderer, scene);
    floor.visible = true;
    for (const lamp of light.lamps) lamp.visible = true;
    return samples;
  };
  const shadow = (): ReturnType<typeof spotsOf> => {
    const { THREE, renderer, scene, ball, floor } = part()!;
    ball.material = floor.material = new THREE.MeshLambertMaterial({ color: 0xffffff });
    ball.castShadow = floor.receiveShadow = true;
    const target = new THREE.WebGLRenderTarget(pictureSize, pictureSize, { type: THREE.FloatType }), rgba = new Float32Array(4 * pictureSize * pictureSize);
    const eye = new THREE.OrthographicCamera(-FLOOR_HALF, FLOOR_HALF, FLOOR_HALF, -FLOOR_HALF, 100, 1000);
    eye.position.set(0, 500, 0);
    eye.up.set(0, 0, -1);
    eye.lookAt(0, 0, 0);
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, eye);
    renderer.readRenderTargetPixels(target, 0, 0, pictureSize, pictureSize, rgba);
    renderer.setRenderTarget(null);
    target.dispose();
    return spotsOf(rgba);
  };
  serve({ radiance, shadow, isReady: () => part() !== undefined && settled(part()!.light), hasMap: () => Boolean(part()?.scene.environment), packet: () => part()!.light.probe.latest() });
}

interface Page {
  /** Of the ball. */
  radiance(kind: string): BallSample[] | Promise<BallSample[]>;
  /** Of the floor in and beside the ball's shadow. */
  shadow(): ReturnType<typeof spotsOf> | Promise<ReturnType<typeof spotsOf>>;
  isReady(): boolean;
  /** Reflections are those of the probe's map. */
  hasMap(): boolean;
  packet(): Estimate | undefined;
}

export function serve(page: Page): void {
  Object.assign(window, { part: page });
}
