// SPDX-License-Identifier: Apache-2.0
/** The parts of lightprobe-webxr.js that need no browser: how light goes over, how bright it is, and what numbers become. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { DataUtils } from "three";
import { halfFloat, srgbCode } from "../src/cube.js";
import { Exposure } from "../src/exposure.js";
import { sceneLight } from "../src/fading.js";
import { fallbackEstimate, irradiance, meanIrradiance, reflected, type Estimate, type ReflectionMap, type Vec3 } from "../src/index.js";
import { reflectionMapTurned } from "../src/reflection_place.js";
import { adapted, adaptedMap } from "../src/shim/engine.js";
import { Fading, type Shown } from "../src/shim/fading.js";
import { readOptions } from "../src/shim/options.js";
import { fromYaw, inverse, turned, type Quaternion } from "../src/turn.js";
import { estimate, lamp } from "./lights.js";

const NORMALS: Vec3[] = Array.from({ length: 80 }, (_, i) => {
  const y = 1 - (2 * (i + 0.5)) / 80, radius = Math.sqrt(1 - y * y);
  return [radius * Math.cos(0.1 + i * 2.399963), y, radius * Math.sin(0.1 + i * 2.399963)]; // none on the edge of a texel
});
const SAME: Quaternion = [0, 0, 0, 1];

const lightOf = ({ coefficients, direction, irradiance: rgb }: Shown): number[] =>
  NORMALS.flatMap((n) => irradiance({ ...estimate([lamp(1, direction, rgb)]), sh: { kind: "AMBIENT", order: 2, coefficients: [...coefficients] } }, n));
const apart = (a: number[], b: number[]): number => Math.max(...a.map((value, i) => Math.abs(value - b[i]!)));
const ofEstimate = (one: Estimate): number[] => NORMALS.flatMap((n) => irradiance(one, n));

const ramp = Array.from({ length: 27 }, (_, i) => (i < 3 ? 1.5 : 0.2 * Math.sin(3 * i)));
const LEFT: Vec3 = [-0.8, 0.6, 0], RIGHT: Vec3 = [0.8, 0.6, 0];
/** Packets one after another: lamps come, go, change places, and the probe starts anew. */
const PACKETS: Record<string, Estimate> = {
  "a lamp on the left": estimate([lamp(1, LEFT, [3, 2, 1])], ramp),
  "it is brighter": estimate([lamp(1, LEFT, [5, 4, 3])], ramp),
  "another one on the right is the strongest": estimate([lamp(2, RIGHT, [4, 4, 4])], ramp),
  "after a new boot, the same room": estimate([lamp(1, RIGHT, [4, 4, 4])], ramp, 2),
  "lamps off": estimate([], ramp, 2),
  "no probe": fallbackEstimate(estimate([], ramp, 2)),
  "a dark room": estimate([], Array(27).fill(0), 3),
};

for (const rateHz of [1, 30, 60, 120])
  test(`at ${rateHz} Hz no frame leaps by more than the packet, and each packet's light is reached`, () => {
    const fading = new Fading();
    let nowMs = 1000, before: number[] | undefined;
    for (const [name, one] of Object.entries(PACKETS)) {
      const target = sceneLight(one, SAME, 1), wanted = ofEstimate(one), whole = before ? apart(before, wanted) : 0;
      const frames = Math.max(3, Math.ceil(2.5 * rateHz));
      for (let i = 0; i < frames; i++) {
        fading.step(target, nowMs);
        const shown = lightOf(fading.shown());
        if (before) {
          const leap = apart(shown, before);
          assert.ok(leap <= whole + 1e-9, `${name}: ${leap} in a frame, the packet changes by ${whole}`);
          if (rateHz >= 30) assert.ok(leap <= 0.5 * whole + 1e-9, `${name}: ${leap} in a frame of ${whole}`);
        }
        before = shown;
        nowMs += 1000 / rateHz;
      }
      assert.ok(apart(before!, wanted) < 1e-3 + 2e-3 * Math.max(...wanted), `${name}: ${apart(before!, wanted)} off`);
    }
  });

test("when the strongest lamp changes, the main light does not leap while it shines", () => {
  const fading = new Fading(), [a, , b] = Object.values(PACKETS);
  fading.step(sceneLight(a!, SAME, 1), 0);
  let before = fading.shown(), turns = 0;
  for (let ms = 10; ms < 2500; ms += 10) {
    fading.step(sceneLight(b!, SAME, 1), ms);
    const shown = fading.shown();
    if (shown.direction[0]! * before.direction[0]! < 0) {
      turns++;
      assert.ok(Math.max(...shown.irradiance, ...before.irradiance) < 0.6, `it shines with ${String(shown.irradiance)} as it leaps`);
    }
    before = shown;
  }
  assert.equal(turns, 1);
  assert.deepEqual(before.direction.map((value) => Math.round(10 * value) / 10), RIGHT);
});

test("two questions in one frame have one answer, and a pause is one short step", () => {
  const fading = new Fading(), [a, , b] = Object.values(PACKETS).map((one) => sceneLight(one, SAME, 1));
  fading.step(a!, 0);
  for (let ms = 16; ms < 100; ms += 16) fading.step(a!, ms);
  fading.step(b!, 112);
  const first = lightOf(fading.shown());
  fading.step(b!, 112.2);
  assert.deepEqual(lightOf(fading.shown()), first);
  const before = lightOf(fading.shown());
  fading.step(b!, 60_000);
  assert.ok(apart(before, lightOf(fading.shown())) < 0.6 * apart(before, ofEstimate(Object.values(PACKETS)[2]!)), "after a minute's pause it leaps");
});

test("a first light is as bright as a page shows it; a lamp is brighter; another boot has units of its own", () => {
  const exposure = new Exposure(undefined), gain = exposure.gain(100, 1, 0);
  assert.ok(Math.abs(100 * gain - Math.PI / 2) < 1e-9);
  for (let ms = 0; ms < 20_000; ms += 50) assert.equal(exposure.gain(ms % 100 ? 400 : 30, 1, ms), gain);
  let before = gain;
  for (let ms = 20_000; ms < 60_000; ms += 50) { // lights on in a dark room
    const now = exposure.gain(100_000, 1, ms);
    assert.ok(now <= before && now > 0.8 * before);
    before = now;
  }
  assert.ok(Math.abs((before * 100_000) / (8 * (Math.PI / 2)) - 1) < 0.01);
  assert.ok(Math.abs(7 * exposure.gain(7, 2, 60_000) - Math.PI / 2) < 1e-9);
  assert.equal(new Exposure(3).gain(100, 1, 0), 3);
  assert.ok(Number.isFinite(new Exposure(undefined).gain(0, 1, 0)), "a dark room");
});

test("turned light is what turned normals see", () => {
  const one = Object.values(PACKETS)[0]!, length = Math.hypot(1, 2, -0.5), axis = [1, 2, -0.5].map((value) => value / length);
  for (const turn of [fromYaw(90), fromYaw(-30), [...axis.map((value) => Math.sin(0.55) * value), Math.cos(0.55)] as Quaternion]) {
    const target = sceneLight(one, turn, 2), shown = new Fading();
    shown.step(target, 0);
    const wanted = NORMALS.flatMap((n) => irradiance(one, turned(inverse(turn), n)).map((value) => 2 * value));
    assert.ok(apart(lightOf(shown.shown()), wanted) < 1e-5);
  }
  turned(fromYaw(90), [0, 0, -1]).forEach((value, a) => assert.ok(Math.abs(value - [-1, 0, 0][a]!) < 1e-9, "data-yaw turns the probe's −Z to the left"));
});

test("a turned map shows in each direction what the map has in the turned one", () => {
  const size = 32, faces = [0, 1, 2, 3, 4, 5].map((face) => Float32Array.from({ length: 3 * size * size }, (_, i) => face + ((i / 3) % size) / size));
  const map: ReflectionMap = { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size, faces, orientation: undefined };
  const turn = fromYaw(90), found = reflectionMapTurned(map, inverse(turn));
  for (const n of NORMALS.filter((d) => { const [a, b] = d.map(Math.abs).sort((x, y) => y - x); return b! / a! < 0.9; }))
    reflected(found, n).forEach((value, c) => assert.ok(Math.abs(value - reflected(map, turned(inverse(turn), n))[c]!) < 0.05, `along ${String(n)}`));
});

test("half floats and sRGB's codes are the nearest ones", () => {
  for (const value of [0, 1e-9, 6e-8, 3e-6, 0.0001, 0.1, 0.5, 0.9999, 1, 1.0004, 3.14159, 1000.3, 65503, 65504])
    assert.ok(Math.abs(DataUtils.fromHalfFloat(halfFloat(value)) - value) <= Math.max(2 ** -25, value * 2 ** -11), `${value}`);
  for (const value of [65505, 1e9, Infinity]) assert.equal(DataUtils.fromHalfFloat(halfFloat(value)), 65504);
  for (const value of [-1, NaN]) assert.equal(halfFloat(value), 0);
  assert.deepEqual([0, 0.001, 0.2140, 0.5, 1, 7, -1].map(srgbCode), [0, 3, 127, 188, 255, 255, 0]);
});

test("Babylon.js' main light is at most 1, and nothing is lost; A-Frame never divides by 0", () => {
  const shown: Shown = { coefficients: Float32Array.from(ramp), direction: [0, 1, 0], irradiance: [4, 2, 1] };
  const babylon = adapted(shown, "babylon");
  assert.deepEqual(babylon.irradiance, [1, 0.5, 0.25]);
  assert.ok(Math.abs(babylon.coefficients[0]! / 0.2820948 - (ramp[0]! + 3 * 0.2820948)) < 1e-5);
  assert.ok(Math.min(...adapted({ ...shown, irradiance: [0, 0, 0] }, "aframe").irradiance) > 0);
  assert.equal(adapted(shown, "none"), shown);
  const map: ReflectionMap = { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size: 16, orientation: undefined,
    faces: [0, 1, 2, 3, 4, 5].map((face) => Float32Array.from({ length: 768 }, (_, i) => 1000 * face + Math.floor(i / 3))) };
  const mirrored = adaptedMap(map, "babylon");
  for (const [x, y, z] of NORMALS) assert.deepEqual(reflected(mirrored, [x, y, -z]), reflected(map, [x, y, z]));
});

test("attributes: what is not said is the default, what is wrong is told", () => {
  const told: string[] = [], warn = (text: string): void => { told.push(text); };
  assert.deepEqual(readOptions({}, "https://shop.example:8443/ar/chair.html?x#y", warn), {
    address: "https://shop.example:8443/", yawDeg: 0, isOnHead: false, exposure: "auto", diffuse: "auto", quirks: "auto", mapSize: 32,
  });
  const all = { probe: "wss://p:7701/#token=abc", yaw: "-90", mount: "head", exposure: "2.5", diffuse: "map", quirks: "babylon", map: "64" };
  assert.deepEqual(readOptions(all, "http://x/", warn), { address: all.probe, yawDeg: -90, isOnHead: true, exposure: 2.5, diffuse: "map", quirks: "babylon", mapSize: 64 });
  assert.equal(told.length, 0, told.join());
  assert.deepEqual(readOptions({ ...all, yaw: "NaN", exposure: "0", quirks: "<b>", map: "48" }, "http://x/", warn), {
    address: all.probe, yawDeg: 0, isOnHead: true, exposure: 1, diffuse: "map", quirks: "auto", mapSize: 32,
  });
  assert.deepEqual(told.map((text) => text.split(":")[0]).sort(), ["data-exposure", "data-map", "data-quirks", "data-yaw"]);
  assert.equal(readOptions({ probe: "ws://0.0.0.0:1/" }, "http://x/", warn), undefined);
  assert.match(told.at(-1)!, /0\.0\.0\.0/);
  assert.ok(meanIrradiance(fallbackEstimate()) > 0);
});
