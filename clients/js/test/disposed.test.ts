// SPDX-License-Identifier: Apache-2.0
/** An object that another replaces in the viewer gives back what it held. */
import assert from "node:assert/strict";
import { test } from "node:test";
import * as THREE from "three";
import { dispose } from "../web/disposed.js";

test("geometries, materials and textures of all parts are given back; the surroundings are not", () => {
  const given: string[] = [], told = <T extends THREE.EventDispatcher<{ dispose: {} }>>(name: string, one: T): T => {
    one.addEventListener("dispose", () => given.push(name));
    return one;
  };
  const picture = { close: (): void => { given.push("picture"); } };
  const map = told("map", new THREE.Texture(picture)), normalMap = told("normalMap", new THREE.Texture()), envMap = told("envMap", new THREE.Texture());
  const shiny = told("shiny", new THREE.MeshStandardMaterial({ map, normalMap, envMap })), dull = told("dull", new THREE.MeshBasicMaterial());
  const mesh = new THREE.Mesh(told("mesh", new THREE.BufferGeometry()), [shiny, dull]), points = new THREE.Points(told("points", new THREE.BufferGeometry()), told("dots", new THREE.PointsMaterial()));
  dispose(new THREE.Group().add(new THREE.Group().add(mesh), points));
  assert.deepEqual(given.sort(), ["dots", "dull", "map", "mesh", "normalMap", "picture", "points", "shiny"]);
});
