// SPDX-License-Identifier: Apache-2.0
/** In Chromium: how long an app's update takes from the bytes of a packet on. Called by updates.ts. */
import * as THREE from "three";
import { decode, type ReflectionMap } from "../../src/index.js";
import { ProbeLight } from "../../src/three.js";
import { Ground, gainByReflectionMap } from "../../web/ground.js";
import { groundToPixels, type Pinhole, type Pose } from "../../web/pose.js";
import { Surroundings } from "../../web/surroundings.js";
import { renderer } from "./picture.js";

const PINHOLE: Pinhole = { focalPx: 500, widthPx: 640, heightPx: 480 };
const PROBE_M = 0.5, SIDE_M = 0.5;

/** A camera 1 m above the ground that looks down at 45°, beside an object at x. */
const poseAbove = (x: number): Pose => {
  const s = Math.SQRT1_2;
  return { rotation: [[1, 0, 0], [0, -s, s], [0, -s, -s]], place: [-x, 0, Math.SQRT2] };
};

function picture(): THREE.Texture {
  const canvas = new OffscreenCanvas(PINHOLE.widthPx, PINHOLE.heightPx), context = canvas.getContext("2d")!;
  context.fillStyle = "#a08060";
  context.fillRect(0, 0, PINHOLE.widthPx, PINHOLE.heightPx);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  return texture;
}

/** Waits until the graphics processor has done all that it was told. */
function finish(): void {
  renderer.getContext().finish();
  const gl = renderer.getContext();
  gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
}

/**
 * Milliseconds for so many objects, the fastest of all rounds, because other programs may run: lamps, SH and the map that metal
 * mirrors, from their bytes until the graphics processor has its commands; and beside that the ground around each object from the
 * AR camera's picture, with the graphics processor's time, because its brightness is read back.
 */
function updates(estimateBytes: number[], mapBytes: number[], objects: number, rounds: number): { cubeMs: number; localMs: number } {
  const light = new ProbeLight(), surroundings = new Surroundings(renderer), seen = picture();
  const materials = Array.from({ length: objects }, () => new THREE.MeshStandardMaterial({ metalness: 1 }));
  const grounds = materials.map(() => new Ground(renderer, SIDE_M)), cubeMs: number[] = [], localMs: number[] = [];
  for (let round = 0; round < rounds; round++) {
    const start = performance.now();
    const estimate = decode(Uint8Array.from(estimateBytes)), message = decode(Uint8Array.from(mapBytes));
    if (estimate?.kind !== "estimate" || message?.kind !== "reflectionMap") throw new Error("no packet");
    light.update(estimate.estimate, round / 30);
    surroundings.update(estimate.estimate, message.reflectionMap, 1000 * round, 0);
    for (const material of materials) Object.assign(material, { envMap: surroundings.texture, envMapIntensity: surroundings.intensity });
    cubeMs.push(performance.now() - start);
    finish();
    const then = performance.now();
    seen.needsUpdate = true; // a new picture of the camera
    grounds.forEach((ground, i) => mirror(ground, seen, (i - 1) * 0.4, message.reflectionMap));
    localMs.push(performance.now() - then);
  }
  return { cubeMs: Math.min(...cubeMs), localMs: Math.min(...localMs) };
}

function mirror(ground: Ground, seen: THREE.Texture, x: number, map: ReflectionMap): void {
  ground.sample(seen, PINHOLE.widthPx, PINHOLE.heightPx, groundToPixels(poseAbove(x), PINHOLE));
  gainByReflectionMap(ground.read(), map, PROBE_M);
}

Object.assign(window, { updates });
