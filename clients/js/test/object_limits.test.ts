// SPDX-License-Identifier: Apache-2.0
/** Objects that ask for more than a page can show, or for a loop without an end: refused before anything is made of them. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { loadedObject } from "../web/object.js";
import { MOST, checkObject, checkObjectSize, checkObjectText, checkPictures, trim } from "../web/object_limits.js";
import { LONG_MS } from "./chromium.js";
import { redCube } from "./gltf.js";

/** The document of a small object that is fine. */
const good = (): Record<string, unknown> => {
  const cube = redCube();
  return JSON.parse(cube.subarray(20, 20 + cube.readUInt32LE(12)).toString()) as Record<string, unknown>;
};
const asText = (text: string): ArrayBuffer => Uint8Array.from(Buffer.from(text)).buffer;
const numbers = (count: number): object => ({ componentType: 5126, count, type: "VEC3" });
const triangles = (count: number, more = {}): object => ({ asset: { version: "2.0" }, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }], accessors: [numbers(count)], meshes: [{ primitives: [{ attributes: { POSITION: 0 }, ...more }] }] });
const nodes = (all: object[], shown = [0]): object => ({ asset: { version: "2.0" }, scenes: [{ nodes: shown }], nodes: all });
const many = <T>(count: number, one: T): T[] => Array.from({ length: count }, () => one);

const REFUSED: [string, object, RegExp][] = [
  ["a billion corners", triangles(1e9), /numbers: 3,000,000,000 of at most/],
  ["corners that are drawn again and again", { ...triangles(1000), nodes: many(9000, { mesh: 0 }) }, /corners of triangles: 9,001,000 of at most 6,000,000/],
  ["corners that are drawn in many places of one node", { ...triangles(1000), nodes: [{ mesh: 0, extensions: { EXT_mesh_gpu_instancing: { attributes: { TRANSLATION: 1 } } } }], accessors: [numbers(1000), numbers(1_000_000)] }, /corners of triangles/],
  ["many forms of one mesh", triangles(1000, { targets: many(10_000, {}) }), /corners of triangles/],
  ["many small parts", { ...triangles(3), meshes: [{ primitives: many(1000, { attributes: { POSITION: 0 } }) }], nodes: many(20, { mesh: 0 }) }, /parts that are drawn one by one: 21,000 of at most 10,000/],
  ["numbers that few bytes change", { ...triangles(3), accessors: [{ ...numbers(3), sparse: { count: 1e9 } }] }, /numbers/],
  ["a node that hangs on itself", nodes([{ children: [1] }, { children: [2] }, { children: [1] }]), /a node hangs on/],
  ["a node that hangs on itself, far from the scene", nodes([{}, { children: [2] }, { children: [1] }]), /a node hangs on itself/],
  ["a node that hangs on two", nodes([{ children: [2] }, { children: [2] }, {}], [0, 1]), /hangs on two others/],
  ["a node that is shown twice", nodes([{}], [0, 0]), /shown twice/],
  ["a chain of nodes", nodes(Array.from({ length: 1000 }, (_, i) => (i < 999 ? { children: [i + 1] } : {}))), /hang one on another: 501 of at most 500/],
  ["nodes in many scenes", { ...nodes(many(1000, {})), scenes: many(1000, { nodes: [0] }) }, /nodes in all scenes/],
  ["a list that is none", { nodes: { length: 1e15 } }, /nodes is no list/],
  ["joints that are no list", { ...nodes([{}]), skins: [{ joints: { length: 1e15 } }] }, /joints is no list/],
  ["a mesh that is not there", nodes([{ mesh: 7 }]), /no such mesh as 7/],
  ["a count that is none", triangles("1e9" as unknown as number), /a count is no count/],
  ["lamps of its own", nodes(many(100, { extensions: { KHR_lights_punctual: { light: 0 } } })), /lamps of its own: 100 of at most 16/],
  ["materials", { materials: many(5000, {}) }, /materials: 5,000 of at most/],
];

test("a small object passes, and what is not shown is left out", () => {
  const document = good();
  checkObject(document);
  Object.assign((document["meshes"] as object[])[0]!, { name: "x".repeat(1000), extras: { note: 1 } });
  document["animations"] = [{ channels: [] }];
  trim(document);
  assert.deepEqual(document["animations"], []);
  assert.deepEqual(Object.keys((document["meshes"] as object[])[0]!), ["primitives"]);
  checkObjectText(Uint8Array.from(redCube()).buffer);
  checkObject(triangles(MOST.corners / 2)); // made once, and drawn once
});

for (const [what, asked, why] of REFUSED) test(`refused: ${what}`, () => { assert.throws(() => checkObject(asked), why); });

test("refused before it is parsed, or read: a file that is too large, and a text of too many values", () => {
  assert.throws(() => checkObjectSize(300 << 20), /has 300 MiB of at most 256/);
  checkObjectSize(256 << 20);
  assert.throws(() => checkObjectText(asText(`[${"[],".repeat(1_000_001)}[]]`)), /more than 2,000,000 values/);
  assert.throws(() => checkObjectText(Uint8Array.from(Buffer.concat([redCube(), ...many(20, Buffer.from([0, 0, 0, 0, 1, 2, 3, 4]))])).buffer), /more than 16 parts/);
  assert.throws(() => checkPictures(many(8, { width: 8192, height: 8192 })), /512 million pixels of at most 128/);
  checkPictures(many(8, { width: 4096, height: 4096 }));
});

const fileOf = (asked: object): File => new File([JSON.stringify({ asset: { version: "2.0" }, ...asked })], "odd.gltf");

for (const [what, asked, why] of REFUSED)
  test(`the loader makes nothing of it: ${what}`, { timeout: LONG_MS }, async () => { await assert.rejects(loadedObject(fileOf(asked)), why); });

test("a triangle is loaded", { timeout: LONG_MS }, async () => {
  let drawn = 0;
  (await loadedObject(fileOf(triangles(3)))).traverse((one) => { if ("isMesh" in one) drawn++; });
  assert.equal(drawn, 1);
});
