// SPDX-License-Identifier: Apache-2.0
/** In Chromium: a picture whose numbers are light, and what its pixels are. */
import * as THREE from "three";
import type { Vec3 } from "../../src/index.js";

export const SIZE = 256;

export const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true, antialias: false });
renderer.outputColorSpace = THREE.LinearSRGBColorSpace;
renderer.setSize(SIZE, SIZE);

/** Pixel at (x, y) of the picture, 0…1 from the lower left. */
export function pixel(x: number, y: number): [number, number, number] {
  const gl = renderer.getContext(), data = new Uint8Array(4);
  gl.readPixels(Math.floor(x * SIZE), Math.floor(y * SIZE), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, data);
  return [data[0]! / 255, data[1]! / 255, data[2]! / 255];
}

/** At the pixel nearest to (u, v), −1…1: the colour, and the normal of a unit sphere seen along z from `side`, 1 or −1. */
export function onSphere(u: number, v: number, side: number): { normal: Vec3; colour: Vec3 } {
  const centre = (place: number): number => (2 * (Math.floor((place / 2 + 0.5) * SIZE) + 0.5)) / SIZE - 1;
  const x = centre(u), y = centre(v);
  return { normal: [x * side, y, Math.sqrt(1 - x * x - y * y) * side], colour: pixel((x + 1) / 2, (y + 1) / 2) };
}

/** The camera of {@link onSphere}: its rays are parallel. */
export function cameraFrom(side: number): THREE.Camera {
  const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 10);
  camera.position.set(0, 0, 5 * side);
  camera.lookAt(0, 0, 0);
  return camera;
}
