// SPDX-License-Identifier: Apache-2.0
/** In Chromium: what three.js draws in the light of an estimate, in numbers. Called by browser.test.ts. */
import * as THREE from "three";
import type { Estimate, Vec3 } from "../../src/index.js";
import { ProbeLight, ShadowCatcher } from "../../src/three.js";

const SIZE = 256;

const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true, antialias: false });
renderer.outputColorSpace = THREE.LinearSRGBColorSpace; // numbers are light
renderer.setSize(SIZE, SIZE);

/** Pixel at (x, y) of the picture, 0…1 from the lower left. */
function pixel(x: number, y: number): [number, number, number] {
  const gl = renderer.getContext(), data = new Uint8Array(4);
  gl.readPixels(Math.floor(x * SIZE), Math.floor(y * SIZE), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, data);
  return [data[0]! / 255, data[1]! / 255, data[2]! / 255];
}

/**
 * A white Lambert sphere, seen from both sides: at each of `count` pixels the normal and the colour, which should be
 * E(normal) / π. Normals are those of the pixels' centres.
 */
function sphere(estimate: Estimate, count: number, turn: [number, number, number, number]): { normal: Vec3; colour: Vec3 }[] {
  const scene = new THREE.Scene(), light = new ProbeLight({ lamps: 8, castShadow: false });
  light.toProbe.set(...turn);
  scene.add(light, new THREE.Mesh(new THREE.SphereGeometry(1, 256, 128), new THREE.MeshLambertMaterial({ color: 0xffffff })));
  light.set(estimate);
  const samples: { normal: Vec3; colour: Vec3 }[] = [];
  for (const side of [1, -1]) {
    const camera = new THREE.OrthographicCamera(-1, 1, 1, -1, 0.1, 10);
    camera.position.set(0, 0, 5 * side);
    camera.lookAt(0, 0, 0);
    renderer.render(scene, camera);
    for (let i = 0; i < count / 2; i++) {
      const radius = 0.92 * Math.sqrt((i + 0.5) / (count / 2)), angle = i * 2.399963;
      const column = Math.floor(((radius * Math.cos(angle)) / 2 + 0.5) * SIZE), row = Math.floor(((radius * Math.sin(angle)) / 2 + 0.5) * SIZE);
      const x = (2 * (column + 0.5)) / SIZE - 1, y = (2 * (row + 0.5)) / SIZE - 1, z = Math.sqrt(1 - x * x - y * y);
      samples.push({ normal: [x * side, y, z * side], colour: pixel((column + 0.5) / SIZE, (row + 0.5) / SIZE) });
    }
  }
  light.dispose();
  return samples;
}

/** Darkening of a floor by a ball above it, seen from the top: in the middle of the shadow, and far away. */
function catcher(estimate: Estimate): { shadow: Vec3; open: Vec3 } {
  const scene = new THREE.Scene(), light = new ProbeLight({ lamps: 1 });
  scene.background = new THREE.Color(1, 1, 1);
  const floor = new ShadowCatcher(new THREE.PlaneGeometry(4, 4).rotateX(-Math.PI / 2));
  const ball = new THREE.Mesh(new THREE.SphereGeometry(0.25, 64, 32), new THREE.MeshLambertMaterial());
  ball.position.set(0, 0.6, 0);
  ball.castShadow = true;
  ball.material.colorWrite = ball.material.depthWrite = false; // it casts its shadow and hides nothing
  scene.add(light, floor, ball);
  light.set(estimate);
  floor.update(light);
  renderer.shadowMap.enabled = true;
  const camera = new THREE.OrthographicCamera(-1.4, 1.4, 1.4, -1.4, 0.1, 10);
  camera.position.set(0, 5, 0);
  camera.lookAt(0, 0, 0);
  renderer.render(scene, camera);
  renderer.shadowMap.enabled = false;
  light.dispose();
  return { shadow: pixel(0.5, 0.5), open: pixel(0.1, 0.1) };
}

Object.assign(window, { sphere, catcher });
