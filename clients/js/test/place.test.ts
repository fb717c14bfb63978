// SPDX-License-Identifier: Apache-2.0
import assert from "node:assert/strict";
import { test } from "node:test";
import { estimateAt, irradiance, lightAt, luminance, reflectionMapAt, type Light, type ReflectionMap, type Room } from "../src/index.js";
import { maps, places, rooms, type PlaceVector } from "./golden.js";
import { estimate, lamp } from "./lights.js";

const known = <T>(value: T | null): T | undefined => value ?? undefined;
const lightOf = (v: PlaceVector): Light => ({
  ...lamp(1, v.direction, v.irradiance), angularRadiusDeg: v.angular_radius_deg, directionSigmaDeg: known(v.direction_sigma_deg),
  irradianceSigma: known(v.irradiance_sigma), distanceM: known(v.distance_m), distanceSigma: known(v.distance_sigma),
  nearestM: known(v.nearest_m), halfAngleDeg: known(v.half_angle_deg), axis: known(v.axis),
});

test("light at a place is the same in every client", () => {
  assert.ok(places.length > 20);
  for (const { light, position_m, there } of places) {
    const got = lightAt(lightOf(light), position_m), want = lightOf(there);
    for (const name of ["direction", "irradiance", "angularRadiusDeg", "directionSigmaDeg", "irradianceSigma", "distanceM", "distanceSigma", "nearestM", "halfAngleDeg", "axis"] as const) {
      const a = [got[name]].flat(), b = [want[name]].flat();
      a.forEach((x, i) => assert.ok(x === b[i] || Math.abs(x! - b[i]!) < 1e-6 * Math.max(1, Math.abs(b[i]!)), `${name}: ${String(a)}, expected ${String(b)}`));
    }
  }
});

test("ambient light at a place is the same in every client", () => {
  assert.ok(rooms.length > 8);
  for (const { room, order, coefficients, position_m, there } of rooms) {
    const here = {
      ...estimate([], coefficients), sh: { kind: "AMBIENT" as const, order, coefficients },
      room: { wallsM: room.walls_m, wallsSigmaM: Array<number>(6).fill(0), orientation: room.orientation, errorPerM: 0.01 },
    };
    const got = estimateAt(here, position_m);
    for (const [found, wanted] of [[got.sh.coefficients, there.coefficients], [got.room!.wallsM, there.walls_m]] as const) {
      assert.equal(found.length, wanted.length);
      found.forEach((x, i) => assert.ok(Math.abs(x - wanted[i]!) < 2e-6, `${position_m}: ${i}: ${x}, expected ${wanted[i]}`));
    }
  }
});

/** As `speckled` of tests/unit/place_vectors.py. */
const speckled = (size: number): ReflectionMap => ({
  sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size, orientation: [0.1, -0.7, 0.1, 0.7],
  faces: Array.from({ length: 6 }, (_, face) => Float32Array.from({ length: 3 * size * size }, (_, i) => (7919 * (3 * face * size * size + i)) % 1009)),
});
const roomOf = (room: { walls_m: number[]; orientation: Room["orientation"] }): Room =>
  ({ wallsM: room.walls_m, wallsSigmaM: Array<number>(6).fill(0), orientation: room.orientation, errorPerM: 0.01 });

test("a reflection map at a place is the same in every client", () => {
  assert.ok(maps.length > 3);
  for (const { room, frame, position_m, there } of maps) {
    const moved = reflectionMapAt(speckled(16), roomOf(room), position_m, frame);
    const got = moved.faces.flatMap((face) => [...face]);
    assert.equal(there.length, Math.ceil(got.length / 67));
    there.forEach((wanted, i) => assert.ok(Math.abs(got[67 * i]! - wanted) < 0.05, `${frame} ${position_m}: ${i}: ${got[67 * i]}, expected ${wanted}`));
  }
});

test("a reflection map stays where there is no place, and at the probe", (t) => {
  const map = speckled(64), room = roomOf(maps[1]!.room);
  assert.equal(reflectionMapAt(map, room, [0, 0, 0], "WORLD"), map);
  assert.throws(() => reflectionMapAt(map, room, [NaN, 0, 0], "PROBE"), /in metres/);
  assert.throws(() => reflectionMapAt({ ...map, orientation: undefined }, room, [1, 0, 0], "WORLD"), /orientation in the WORLD/);
  const tookMs = Array.from({ length: 30 }, (_, i) => {
    const startMs = performance.now();
    reflectionMapAt(map, room, [0.5, 0.01 * i, 0], "PROBE");
    return performance.now() - startMs;
  }).sort((a, b) => a - b);
  t.diagnostic(`a map of 64 texels at a place: ${tookMs[15]!.toFixed(2)} ms (median of 30)`);
});

test("an estimate at a place: strongest first, shadows by all the light there, the SH as they are", () => {
  const near = { ...lamp(1, [0, 1, 0], [1, 1, 1]), distanceM: 1, shadowStrength: 0.3 };
  const far = { ...lamp(2, [0.6, 0.8, 0], [2, 2, 2]), distanceM: 3, shadowStrength: 0.5 };
  const here = estimate([far, near]), there = estimateAt(here, [0, 0.6, 0]);
  assert.deepEqual(there.lights.map((light) => light.id), [1, 2]);
  assert.ok(Math.abs(there.lights[0]!.irradiance[0] - 6.25) < 1e-9);
  const up = luminance(irradiance(there, [0, 1, 0]));
  assert.ok(Math.abs(there.lights[0]!.shadowStrength! - luminance(there.lights[0]!.irradiance) / up) < 1e-9);
  assert.equal(there.sh, here.sh);
  assert.equal(estimateAt(here, [0, 0, 0]), here);
  assert.throws(() => estimateAt({ ...here, sh: { ...here.sh, kind: "TOTAL" } }, [1, 0, 0]), /subscribe to AMBIENT/);
  assert.throws(() => estimateAt(here, [NaN, 0, 0]), /in metres/);
});
