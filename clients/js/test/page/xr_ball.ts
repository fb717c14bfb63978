// SPDX-License-Identifier: Apache-2.0
/** A ball of radius 1 at the origin of a three.js scene, seen from five sides, in numbers. */
import type * as Three from "three";

export type Numbers3 = [number, number, number];
export interface BallSample {
  normal: Numbers3;
  /** Unit vector towards the eye. */
  view: Numbers3;
  /** Linear. */
  radiance: Numbers3;
}

const SIZE = 128, STEP = 6, RIM = 0.9;

/** Where the eye is, and what is up there. */
export const SIDES: [Numbers3, Numbers3][] = [[[0, 0, 1], [0, 1, 0]], [[0, 0, -1], [0, 1, 0]], [[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 0, -1]], [[0, -1, 0], [0, 0, 1]]];

/** Pixels of a picture of SIZE × SIZE, rows from below, and the normals of the ball there. */
export function places([back, up]: [Numbers3, Numbers3]): { at: number; normal: Numbers3 }[] {
  const right: Numbers3 = [up[1] * back[2] - up[2] * back[1], up[2] * back[0] - up[0] * back[2], up[0] * back[1] - up[1] * back[0]], found: { at: number; normal: Numbers3 }[] = [];
  for (let row = 2; row < SIZE; row += STEP)
    for (let column = 2; column < SIZE; column += STEP) {
      const u = (2 * (column + 0.5)) / SIZE - 1, v = (2 * (row + 0.5)) / SIZE - 1, square = u * u + v * v;
      if (square > RIM * RIM) continue;
      const w = Math.sqrt(1 - square);
      found.push({ at: row * SIZE + column, normal: [0, 1, 2].map((a) => u * right[a]! + v * up[a]! + w * back[a]!) as Numbers3 });
    }
  return found;
}

export const pictureSize = SIZE;

/** Off the screen, linear, in 32-bit floats, by the page's own renderer, scene and lights. */
export function readBall(THREE: typeof Three, renderer: Three.WebGLRenderer, scene: Three.Scene): BallSample[] {
  const target = new THREE.WebGLRenderTarget(SIZE, SIZE, { type: THREE.FloatType }), samples: BallSample[] = [], rgba = new Float32Array(4 * SIZE * SIZE);
  const isXr = renderer.xr.enabled, tone = renderer.toneMapping;
  renderer.xr.enabled = false;
  renderer.toneMapping = THREE.NoToneMapping;
  for (const side of SIDES) {
    const eye = new THREE.OrthographicCamera(-1, 1, 1, -1, 100, 1000); // far away: shaders look from the camera's place
    eye.position.set(...side[0]).multiplyScalar(500);
    eye.up.set(...side[1]);
    eye.lookAt(0, 0, 0);
    renderer.setRenderTarget(target);
    renderer.clear();
    renderer.render(scene, eye);
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, rgba);
    for (const { at, normal } of places(side)) samples.push({ normal, view: side[0], radiance: [rgba[4 * at]!, rgba[4 * at + 1]!, rgba[4 * at + 2]!] });
  }
  renderer.setRenderTarget(null);
  renderer.xr.enabled = isXr;
  renderer.toneMapping = tone;
  target.dispose();
  return samples;
}
