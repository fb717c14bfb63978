// SPDX-License-Identifier: Apache-2.0
/** Blurred levels of reflection maps, against those of the Python package. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { resolve } from "node:path";
import { test } from "node:test";
import { ggxLevels, type ReflectionMap } from "../src/index.js";
import { texelSolidAngles } from "../src/reflection.js";
import { ROOT } from "./golden.js";

function mapOf(size: number, value: (index: number) => number): ReflectionMap {
  const faces = Array.from({ length: 6 }, (_, face) => Float32Array.from({ length: 3 * size * size }, (_, i) => value(face * 3 * size * size + i)));
  return { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "TOTAL", size, faces, orientation: undefined };
}

const flat = (map: ReflectionMap): number[] => map.faces.flatMap((face) => [...face]);

test("levels are those of the Python package, which adds up all texels, within 0.5 %", () => {
  for (const size of [16, 64]) {
    const map = mapOf(size, (i) => 1 + Math.sin(i * 0.7) ** 2 + (i === 1234 ? 500 : 0)), before = process.cpuUsage(), levels = ggxLevels(map, 3);
    const { user, system } = process.cpuUsage(before);
    console.log(`three levels of a map of ${size} texels: ${((user + system) / 1000).toFixed(0)} ms of processor time`);
    assert.deepEqual(levels.map((level) => level.size), [size, size / 2, size / 4]);
    const output = execFileSync(resolve(ROOT, "build/venv/bin/python"), [resolve(ROOT, "clients/js/test/prefiltered.py")], {
      input: JSON.stringify({ size, faces: flat(map), count: 3 }), maxBuffer: 1 << 26,
    });
    (JSON.parse(output.toString()) as number[][]).forEach((expected, level) => {
      const found = flat(levels[level]!);
      assert.equal(found.length, expected.length);
      expected.forEach((value, i) => assert.ok(Math.abs(found[i]! - value) < 5e-3 * value, `level ${level}, number ${i}: ${found[i]}, expected ${value}`));
    });
  }
});

test("uniform light stays as it is", () => {
  for (const level of ggxLevels(mapOf(16, () => 7), 4))
    for (const value of flat(level)) assert.ok(Math.abs(value - 7) < 1e-4);
});

test("solid angles cover the sphere", () => {
  const sum = texelSolidAngles(32).reduce((total, value) => total + value, 0);
  assert.ok(Math.abs(6 * sum - 4 * Math.PI) < 1e-4);
});

test("levels that there cannot be are refused", () => {
  for (const count of [1, 0, 6, 2.5, Number.NaN]) assert.throws(() => ggxLevels(mapOf(16, () => 1), count), /expected 2 or more/);
});
