// SPDX-License-Identifier: Apache-2.0
/** In headless Chromium: pixels against the formulas, and reflections of a live lamp. */
import assert from "node:assert/strict";
import { test } from "node:test";
import type { Page } from "playwright-core";
import { create, toBinary } from "@bufbuild/protobuf";
import { decode, irradiance, largest, reflected, type Estimate, type ReflectionMap, type Vec3 } from "../src/index.js";
import * as pb from "../src/gen/lightprobe_pb.js";
import { LONG_MS, pageWith } from "./chromium.js";
import { live } from "./live.js";
import { packets } from "./packets.js";

const session = live(), { daemon } = session;

// ---------------------------------------------------------------- pixels

const light = (direction: Vec3, rgb: Vec3): object => ({ id: 1 + Math.round(1000 * direction[0] + 10 * direction[2] + 5000), direction: [...direction], irradiance: [...rgb], angularRadiusDeg: 2 });
const sh = (values: number[]): object => ({ kind: 1, order: 2, coefficients: Array.from({ length: 27 }, (_, i) => values[i] ?? 0) });

/** Five packets, as bytes: what the wire does to numbers is in them. Brightest irradiance below π: white is 1. */
const PACKETS: Record<string, object> = {
  "ambient alone": { sh: sh([1.6, 1.2, 0.8]) },
  "a lamp straight up": { lights: [light([0, 1, 0], [2, 1.5, 1])], sh: sh([]) },
  "a lamp aside in a sloping room": { lights: [light([0.6, 0.48, 0.64], [1.2, 0.9, 0.6])], sh: sh([0.9, 0.9, 1.1, 0.3, 0.25, 0.2, -0.2, 0.1, 0.1, 0.15, -0.2, 0.05]) },
  "four lamps": { lights: [light([1, 0, 0], [0.8, 0.2, 0.1]), light([0, 0, 1], [0.1, 0.7, 0.2]), light([0, 0, -1], [0.2, 0.2, 0.9]), light([0, -1, 0], [0.5, 0.5, 0.5])], sh: sh([0.7, 0.7, 0.7]) },
  "all nine coefficients": { sh: sh([1.5, 1.4, 1.3, 0.3, 0.2, 0.1, -0.3, 0.2, 0.1, 0.2, -0.2, 0.3, 0.2, 0.1, -0.2, 0.15, 0.1, 0.2, -0.2, 0.3, 0.1, 0.1, -0.1, 0.2, 0.25, 0.1, -0.3]) },
};

function packet(name: string): Estimate {
  const bytes = toBinary(pb.FromProbeSchema, create(pb.FromProbeSchema, { message: { case: "estimate", value: create(pb.EstimateSchema, PACKETS[name] as never) } }));
  const message = decode(bytes);
  assert.equal(message?.kind, "estimate");
  return (message as { estimate: Estimate }).estimate;
}

let numbers: Page | undefined;
const numbersPage = async (): Promise<Page> => (numbers ??= await pageWith(session.browser, "sphere.ts"));

type Sphere = (estimate: Estimate, count: number, turn: number[]) => { normal: Vec3; colour: Vec3 }[];

const TURNS: Record<string, number[]> = { "as the probe stands": [0, 0, 0, 1], "turned about two axes": [0.3, 0.5, 0.1, Math.sqrt(1 - 0.35)] };

/** A direction of the scene in the probe's axes: v + 2 q × (q × v + w v). */
function toProbe([qx, qy, qz, qw]: number[], [x, y, z]: Vec3): Vec3 {
  const t = [2 * (qy! * z - qz! * y), 2 * (qz! * x - qx! * z), 2 * (qx! * y - qy! * x)];
  return [x + qw! * t[0]! + qy! * t[2]! - qz! * t[1]!, y + qw! * t[1]! + qz! * t[0]! - qx! * t[2]!, z + qw! * t[2]! + qx! * t[1]! - qy! * t[0]!];
}

for (const name of Object.keys(PACKETS))
  for (const [how, turn] of Object.entries(TURNS))
    test(`a white sphere is E(n)/π at 100 normals: ${name}, ${how}`, { timeout: LONG_MS }, async () => {
      const page = await numbersPage(), estimate = packet(name);
      const samples = await page.evaluate(({ estimate, turn }) => (window as unknown as { sphere: Sphere }).sphere(estimate, 100, turn), { estimate, turn });
      assert.equal(samples.length, 100);
      let worst = 0, brightest = 0;
      for (const { normal, colour } of samples)
        irradiance(estimate, toProbe(turn, normal)).forEach((value, c) => {
          const wanted = Math.min(1, Math.max(0, value / Math.PI));
          brightest = Math.max(brightest, wanted);
          worst = Math.max(worst, Math.abs(wanted - colour[c]!));
        });
      assert.ok(brightest > 0.3 && brightest < 1, `the packet is no test: brightest ${brightest}`);
      assert.ok(worst <= 2 / 255, `${(255 * worst).toFixed(2)}/255 off`);
    });

test("a shadow is as dark as the lamp's share of the light", { timeout: LONG_MS }, async () => {
  const page = await numbersPage();
  const estimate = { ...packet("a lamp straight up"), sh: packet("ambient alone").sh };
  const { shadow, open } = await page.evaluate((value) => (window as unknown as { catcher: (e: Estimate) => { shadow: Vec3; open: Vec3 } }).catcher(value), estimate);
  const whole = irradiance(estimate, [0, 1, 0]), ambient = irradiance({ ...estimate, lights: [] }, [0, 1, 0]);
  for (let c = 0; c < 3; c++) {
    assert.ok(Math.abs(open[c]! - 1) <= 2 / 255, `beside the shadow ${open[c]}`);
    assert.ok(Math.abs(shadow[c]! - ambient[c]! / whole[c]!) <= 2 / 255, `in the shadow ${shadow[c]}, expected ${ambient[c]! / whole[c]!}`);
  }
});

// ---------------------------------------------------------------- reflections

/** Every face has a colour of its own, and slopes along both of its edges, so that no turn or mirror image of it fits. */
function slopingFaces(): ReflectionMap {
  const size = 32, colours: Vec3[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, 0, 1], [0, 1, 1]];
  const faces = colours.map((colour) => {
    const rgb = new Float32Array(3 * size * size);
    for (let i = 0; i < size * size; i++)
      colour.forEach((value, c) => { rgb[3 * i + c] = 100 * (value * (0.3 + (0.5 * (i % size)) / size) + (0.2 * Math.floor(i / size)) / size); });
    return rgb;
  });
  return { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "TOTAL", size, faces, orientation: undefined };
}

/** Away from the faces' edges, where colours change at once. */
const inside = (direction: Vec3): boolean => {
  const [first, second] = direction.map(Math.abs).sort((a, b) => b - a) as [number, number, number];
  return second / first < 0.9;
};

const GRID: [number, number][] = Array.from({ length: 441 }, (_, i): [number, number] => [((i % 21) - 10) / 10.5, (Math.floor(i / 21) - 10) / 10.5]).filter(([u, v]) => Math.hypot(u, v) < 0.93);

type Sample = { towards: Vec3; radiance: Vec3 };
const inMirror = async (map: ReflectionMap, rough: boolean): Promise<Sample[]> => (await numbersPage()).evaluate(
  ({ map, places, rough }) => (window as unknown as { mirror: (...all: unknown[]) => Sample[] }).mirror(map, places, rough), { map, places: GRID, rough });

for (const [how, rough, most] of [["as it is", false, 0.04], ["by a physical material", true, 0.08]] as const)
  test(`a mirror ball shows the map where it lies: ${how}`, { timeout: LONG_MS }, async () => {
    const map = slopingFaces(), seen = new Set<number>();
    for (const { towards, radiance } of await inMirror(map, rough)) {
      if (!inside(towards)) continue;
      const expected = reflected(map, towards);
      seen.add(towards.map(Math.abs).indexOf(Math.max(...towards.map(Math.abs))) * 2 + Number(towards[towards.map(Math.abs).indexOf(Math.max(...towards.map(Math.abs)))]! < 0));
      expected.forEach((value, c) => assert.ok(Math.abs(value - radiance[c]!) < most * largest(map), `along ${String(towards)}: ${String(radiance)}, expected ${String(expected)}`));
    }
    assert.equal(seen.size, 6, "not every face was seen");
  });

test("WebXR's cube map is looked up where the map lies", { timeout: LONG_MS }, async () => {
  const map = slopingFaces(), gain = 1 / largest(map);
  const towards = Array.from({ length: 200 }, (_, i): Vec3 => {
    const y = 1 - (2 * (i + 0.5)) / 200, radius = Math.sqrt(1 - y * y);
    return [radius * Math.cos(i * 2.399963), y, radius * Math.sin(i * 2.399963)];
  }).filter(inside);
  const found = await (await numbersPage()).evaluate(
    ({ map, towards, gain }) => (window as unknown as { lookUp: (...all: unknown[]) => Vec3[] }).lookUp(map, towards, gain), { map, towards, gain });
  found.forEach((radiance, i) => reflected(map, towards[i]!).forEach((value, c) => assert.ok(Math.abs(value - radiance[c]!) < 0.04 * largest(map), `along ${String(towards[i])}`)));
});

test("a mirror ball shows the live lamp where it is", { timeout: LONG_MS }, async () => {
  const found = await packets(session.browser, daemon.port, { size: 32, rateHz: 30 });
  const [estimate, message] = [found.estimate, found.map].map((bytes) => decode(Uint8Array.from(bytes)));
  assert.ok(estimate?.kind === "estimate" && message?.kind === "reflectionMap");
  const map = message.reflectionMap, lamp = estimate.estimate.lights[0]!.direction;
  const brightest = (await inMirror(map, false)).reduce((best, one) => (one.radiance[1] > best.radiance[1] ? one : best));
  const cosine = lamp.reduce((sum, value, a) => sum + value * brightest.towards[a]!, 0);
  assert.ok(Math.acos(Math.min(1, cosine)) < (8 * Math.PI) / 180, `lamp at ${String(lamp)}, in the mirror at ${String(brightest.towards)}`); // places are 5° apart
  assert.ok(brightest.radiance[1] > 20 * reflected(map, [0, -1, 0])[1]);
});
