// SPDX-License-Identifier: Apache-2.0
/** In Chromium: plates of one of the viewer's materials, in numbers. Called by materials.test.ts. */
import * as THREE from "three";
import type { Estimate, ReflectionMap, Vec3 } from "../../src/index.js";
import { ProbeLight } from "../../src/three.js";
import { SurfaceMaterial, type Surface } from "../../web/surface.js";
import { mippedCube } from "../../web/surroundings.js";
import { SIZE, cameraFrom, pixel, renderer } from "./picture.js";

const PLATE_PX = 4;
export const COLUMNS = SIZE / PLATE_PX;
const QUAD = [[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]] as const;

/** One plate per normal, row by row as a camera at ±z sees them. A sphere's pixels would have less exact normals. */
export function plates(normals: Vec3[], side: number): THREE.BufferGeometry {
  const positions = normals.flatMap((_, i) => QUAD.flatMap(([u, v]) => [
    side * ((2 * ((i % COLUMNS) + u)) / COLUMNS - 1), (2 * (Math.floor(i / COLUMNS) + v)) / COLUMNS - 1, 0]));
  return new THREE.BufferGeometry()
    .setAttribute("position", new THREE.Float32BufferAttribute(positions, 3))
    .setAttribute("normal", new THREE.Float32BufferAttribute(normals.flatMap((normal) => QUAD.flatMap(() => normal)), 3));
}

/** Radiance · gain of surfaces with these normals, in the same order; each is seen along z from the side that it faces. */
function shine(surface: Surface, estimate: Estimate, map: ReflectionMap | undefined, normals: Vec3[], gain: number): Vec3[] {
  const light = new ProbeLight({ lamps: 4, castShadow: false }), material = new SurfaceMaterial(surface), cube = map && mippedCube(map);
  material.setSurroundings(cube);
  light.set(estimate);
  renderer.toneMapping = THREE.LinearToneMapping;
  renderer.toneMappingExposure = gain;
  const colours: Vec3[] = [];
  for (const side of [1, -1]) {
    const places = normals.map((_, i) => i).filter((i) => normals[i]![2] * side > 0);
    const geometry = plates(places.map((i) => normals[i]!), side);
    renderer.render(new THREE.Scene().add(light, new THREE.Mesh(geometry, material)), cameraFrom(side));
    places.forEach((i, k) => { colours[i] = pixel(((k % COLUMNS) + 0.5) / COLUMNS, (Math.floor(k / COLUMNS) + 0.5) / COLUMNS); });
    geometry.dispose();
  }
  light.dispose();
  cube?.texture.dispose();
  return colours;
}

Object.assign(window, { shine });
