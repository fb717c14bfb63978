// SPDX-License-Identifier: Apache-2.0
/** The viewer's plan of the room: lamps at their places, and an object that is lit where the user moves it. */
import assert from "node:assert/strict";
import { test } from "node:test";
import { fromBinary, toBinary } from "@bufbuild/protobuf";
import type { Page } from "playwright-core";
import * as pb from "../src/gen/lightprobe_pb.js";
import { reflectionMapAt, type ReflectionMap, type Vec3 } from "../src/index.js";
import { Mirrored, cornersOf, halfWidthM, missingInWords, placeInWords, spotOf } from "../web/places.js";
import { LONG_MS } from "./chromium.js";
import { redCube } from "./gltf.js";
import { estimate, lamp } from "./lights.js";
import { live } from "./live.js";

const session = live();
const room = { wallsM: [1, 2, 1.2, 1.5, 3, 4], wallsSigmaM: Array<number>(6).fill(0), orientation: [0, 0, 0, 1] as [number, number, number, number], errorPerM: 0.01 };

test("a lamp's sigmas in the plan are those of its place, seen from above", () => {
  const known = (direction: Vec3) => spotOf({ ...lamp(1, direction), distanceM: 2, distanceSigma: 0.1, directionSigmaDeg: 1 })!;
  const near = (value: number, wanted: number): void => assert.ok(Math.abs(value - wanted) < 1e-9, `${value}, expected ${wanted}`);
  const asideM = (2 * Math.PI) / 180, level = known([0.6, 0, -0.8]), above = known([0, 1, 0]);
  near(level.xM, 1.2); near(level.zM, -1.6); near(level.alongM, 0.2); near(level.acrossM, asideM);
  near(above.alongM, asideM); near(above.acrossM, asideM);
  assert.equal(spotOf(lamp(1, [0, 1, 0])), undefined);
});

test("the plan keeps its scale while lamps move a little, and shows the object", () => {
  const at = (distanceM: number) => [spotOf({ ...lamp(1, [1, 0, 0]), distanceM })!];
  assert.equal(halfWidthM(at(2.5), [0, 0, 0], 1), 3);
  assert.equal(halfWidthM(at(1.6), [0, 0, 0], 3), 3);
  assert.equal(halfWidthM(at(0.5), [0, 0, 0], 3), 1);
  assert.equal(halfWidthM(at(0.5), [0, 0, -4], 3), 5);
  assert.equal(halfWidthM(at(50), [0, 0, 0], 2), 2);
});

test("the plan shows the walls of the room, whichever of its axes is upright", () => {
  const near = (found: [number, number][], wanted: [number, number][]): void => {
    const sorted = (list: [number, number][]): number[] => [...list].sort(([a, b], [c, d]) => Math.round(100 * (a - c)) || b - d).flat();
    sorted(found).forEach((x, i) => assert.ok(Math.abs(x - sorted(wanted)[i]!) < 1e-9, `${String(found)}, expected ${String(wanted)}`));
  };
  near(cornersOf(room), [[-1, -3], [2, -3], [2, 4], [-1, 4]]);
  near(cornersOf({ ...room, orientation: [0, Math.SQRT1_2, 0, Math.SQRT1_2] }), [[-3, 1], [-3, -2], [4, -2], [4, 1]]);
  near(cornersOf({ ...room, orientation: [Math.SQRT1_2, 0, 0, Math.SQRT1_2] }), [[-1, -1.2], [2, -1.2], [2, 1.5], [-1, 1.5]]);
  assert.equal(halfWidthM([], [0, 0, 0], 1, cornersOf(room)), 5);
  assert.match(missingInWords({ ...estimate([]), room }), /so ambient light and what is mirrored change with the place, lamps light the object as at the probe\.$/);
});

test("objects mirror the room from where they stand: made anew for a new map or place, and only where the room is known", () => {
  const faces = Array.from({ length: 6 }, (_, face) => Float32Array.from({ length: 3 * 16 * 16 }, (_, i) => face + i / 1000));
  const map: ReflectionMap = { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size: 16, faces, orientation: undefined };
  const mirrored = new Mirrored(), placeM: Vec3 = [0.5, 0, -1], here = estimate([]), known = { ...here, room };
  assert.equal(mirrored.at(map, here, placeM), map);
  const there = mirrored.at(map, known, placeM);
  assert.deepEqual(there, reflectionMapAt(map, room, placeM, "PROBE"));
  assert.notDeepEqual(there.faces, map.faces);
  assert.equal(mirrored.at(map, { ...known, room: { ...room } }, placeM), there);
  assert.notEqual(mirrored.at({ ...map }, known, placeM), there);
  assert.deepEqual(mirrored.at(map, known, [0, 0, 0]), map);
  assert.equal(mirrored.at(map, here, placeM), map);
});

test("the plan says where the object stands, and what is not known", () => {
  assert.equal(placeInWords([0, 0, 0]), "Object: at the probe");
  assert.equal(placeInWords([-0.5, -0.2, 0.3]), "Object: 0.50 m left of, 0.30 m behind, 0.20 m below the probe");
  const far = lamp(1, [0, 1, 0]), near = { ...lamp(2, [1, 0, 0]), distanceM: 1 };
  assert.match(missingInWords(estimate([far])), /^No distance of a lamp is known, so the object is lit as at the probe\.$/);
  assert.match(missingInWords(estimate([far, near])), /: 1 of 2\.$/);
  assert.equal(missingInWords(estimate([near])), "");
});

// ---------------------------------------------------------------- the page

/** Metres from the probe, in its axes. */
const LAMP: Vec3 = [0.9, 0.7, -0.3];
const CUBE = { name: "cube.glb", mimeType: "model/gltf-binary", buffer: redCube() };
/** Of the view from above: 0.3 to 1.4 at its steepest; the page's own turn of 0.35 less four steps. */
const AZIMUTH = -0.05, ELEVATION = 1.4;

/** The viewer, with one lamp and no other light in what the probe sends. */
async function roomWithLamp(): Promise<{ page: Page; faults: string[]; forget: () => void }> {
  const page = await session.browser.newPage({ viewport: { width: 780, height: 420 }, reducedMotion: "reduce" }), faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  let isKnown = true;
  await page.routeWebSocket(/./, (socket) => {
    const probe = socket.connectToServer();
    probe.onMessage((data) => {
      const whole = fromBinary(pb.FromProbeSchema, data as Buffer), { message } = whole;
      if (message.case === "estimate") placeLamp(message.value, isKnown);
      socket.send(Buffer.from(toBinary(pb.FromProbeSchema, whole)));
    });
  });
  await page.goto(`http://127.0.0.1:${session.daemon.port}/`, { timeout: LONG_MS });
  await page.waitForFunction(() => Number(document.body.dataset["frames"]) > 3 && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  return { page, faults, forget: () => { isKnown = false; } };
}

function placeLamp(sent: pb.Estimate, isKnown: boolean): void {
  const first = sent.lights[0], awayM = Math.hypot(...LAMP);
  if (!first) return;
  sent.lights = [Object.assign(first, { id: 7, direction: LAMP.map((value) => value / awayM), ...(isKnown ? { distanceM: awayM, distanceSigmaPermille: 30 } : {}) })];
  sent.sh!.coefficients = sent.sh!.coefficients.map(() => 0);
}

/** The cube alone, seen from above. */
async function lookDown(page: Page): Promise<void> {
  await page.locator("#object").setInputFiles(CUBE);
  await page.locator("#use-map").uncheck();
  await page.locator("#view").focus();
  for (let i = 0; i < 4; i++) await page.keyboard.press("ArrowLeft");
  for (let i = 0; i < 25; i++) await page.keyboard.press("ArrowUp");
}

/** Azimuth of the cube's shadow in the picture, from +X towards +Z, in degrees: the mean direction of what is dark beside the cube. */
async function shadowDeg(page: Page): Promise<number> {
  const drawn = await page.evaluate(() => Number(document.body.dataset["frames"]));
  await page.waitForFunction((wanted) => Number(document.body.dataset["frames"]) > wanted, drawn + 9, { timeout: LONG_MS });
  const { pixels, size } = await page.evaluate(() => {
    const size = 128, small = new OffscreenCanvas(size, size).getContext("2d")!;
    small.drawImage(document.querySelector<HTMLCanvasElement>("#view")!, 0, 0, size, size);
    return { pixels: [...small.getImageData(0, 0, size, size).data], size };
  });
  let x = 0, z = 0, count = 0;
  for (let i = 0; i < size * size; i++) {
    const right = (i % size) - size / 2, down = (Math.floor(i / size) - size / 2) / Math.sin(ELEVATION), away = Math.hypot(right, down);
    if (away < 0.27 * size || away > 0.47 * size || pixels[4 * i]! > 12) continue; // the cube's middle, the corners; what is lit, and the cube, which is red
    [x, z, count] = [x + right / away, z + down / away, count + 1];
  }
  assert.ok(count > 50, `only ${count} dark pixels`);
  return ((Math.atan2(z, x) - AZIMUTH) * 180) / Math.PI;
}

/** The same by geometry: the shadow lies away from the lamp. */
const expectedDeg = (place: Vec3): number => (Math.atan2(place[2] - LAMP[2], place[0] - LAMP[0]) * 180) / Math.PI;

/** Within 10°: the cube is no thin pole, and hides a part of its shadow. Light as at the probe is 107° off. */
function isAlong(found: number, wanted: number): void {
  const off = ((found - wanted + 540) % 360) - 180;
  console.log(`shadow along ${found.toFixed(1)}°, expected ${wanted.toFixed(1)}°`);
  assert.ok(Math.abs(off) < 10, `the shadow is ${off.toFixed(1)}° off`);
}

/** Pulls the object with the mouse, by shares of the plan's width. */
async function drag(page: Page, right: number, down: number): Promise<void> {
  await page.locator("#plan").scrollIntoViewIfNeeded();
  const box = (await page.locator("#plan").boundingBox())!, x = box.x + box.width / 2, y = box.y + box.height / 2;
  await page.mouse.move(x + 5, y);
  await page.mouse.down();
  await page.mouse.move(x + (right * box.width) / 2, y + (down * box.height) / 2, { steps: 3 });
  await page.mouse.up();
}

const words = (page: Page): Promise<string | null> => page.locator("#plan-place").textContent();

test("an object that is moved in the plan is lit where it stands, and casts its shadow there", { timeout: 6 * LONG_MS }, async () => {
  const { page, faults, forget } = await roomWithLamp();
  await page.waitForFunction(() => !document.getElementById("plan-room")!.hidden, null, { timeout: LONG_MS });
  assert.equal((await page.locator("#lamps tbody tr:first-child td").allTextContents())[4], "1.18 m");
  await lookDown(page);
  isAlong(await shadowDeg(page), expectedDeg([0, 0, 0]));
  await drag(page, 1.4 / 2.1, 0.5 / 2.1); // the plan shows 2 m and a margin of a twentieth
  const found = /^Object: (\d\.\d\d) m right of, (\d\.\d\d) m behind the probe$/.exec((await words(page))!);
  assert.ok(found, (await words(page))!);
  const [x, z] = [Number(found[1]), Number(found[2])];
  assert.ok(Math.abs(x - 1.4) < 0.03 && Math.abs(z - 0.5) < 0.03, (await words(page))!);
  await page.locator("#plan").focus();
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("Shift+ArrowLeft");
  await page.locator("#plan-height").fill("-0.1");
  const stands = placeInWords([x - 0.01, -0.1, z - 0.1]);
  assert.equal(await words(page), stands);
  const shown = await page.evaluate(() => Number(document.body.dataset["sequence"]));
  await page.waitForFunction((before) => Number(document.body.dataset["sequence"]) > before + 3, shown, { timeout: LONG_MS });
  assert.equal(await words(page), stands); // however many packets come
  isAlong(await shadowDeg(page), expectedDeg([x - 0.01, -0.1, z - 0.1]));
  forget();
  await page.waitForFunction(() => /^No distance/.test(document.getElementById("plan-missing")!.textContent!), null, { timeout: LONG_MS });
  isAlong(await shadowDeg(page), expectedDeg([0, 0, 0])); // as at the probe
  assert.deepEqual(faults, []);
  await page.close();
});
