// SPDX-License-Identifier: Apache-2.0
/** The viewer over a camera's picture: the printed marker, the ground that objects mirror, and the page with a simulated camera. */
import assert from "node:assert/strict";
import { execFileSync, spawn, type ChildProcess } from "node:child_process";
import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { Estimate, ReflectionMap, Vec3 } from "../src/index.js";
import { findMarker } from "../web/marker.js";
import { cameraPlace, poseOf, type Pinhole, type Pose } from "../web/pose.js";
import { LONG_MS, launch, pageWith } from "./chromium.js";
import { DAEMON, freePort, panorama } from "./daemon.js";
import { ROOT } from "./golden.js";

const WIDTH = 640, HEIGHT = 480, EDGE_M = 0.4;
const PINHOLE: Pinhole = { focalPx: WIDTH / 2 / Math.tan((65 * Math.PI) / 360), widthPx: WIDTH, heightPx: HEIGHT };

interface Truth { place: number[]; right: number[]; up: number[]; back: number[] }

const table = <T>(word: string, asked: unknown): T => JSON.parse(execFileSync(resolve(ROOT, "build/venv/bin/python"), [resolve(ROOT, "clients/js/test/table.py"), word], { input: JSON.stringify(asked), maxBuffer: 1 << 28 }).toString()) as T;
const imageOf = (base64: string): ImageData => ({ data: new Uint8ClampedArray(Buffer.from(base64, "base64")), width: WIDTH, height: HEIGHT, colorSpace: "srgb" }) as ImageData;
const degrees = (a: number[], b: number[]): number => (Math.acos(Math.min(1, a.reduce((sum, value, i) => sum + value * b[i]!, 0))) * 180) / Math.PI;
const distance = (a: number[], b: number[]): number => Math.hypot(...a.map((value, i) => value - b[i]!));

// ---------------------------------------------------------------- marker

test("the printed marker tells where the camera is, within 1° and 2 %", { timeout: LONG_MS }, () => {
  const poses = [[0.5, 0.9, 1.3, 0.1, 0, -0.1], [-0.8, 0.7, 0.9, 0, 0, 0], [0, 2.2, 0.9, 0.2, 0, 0], [-0.6, 1.5, -1, 0, 0, 0.2], [1.6, 1.2, 1.6, 0, 0, 0]];
  for (const { picture, ...truth } of table<(Truth & { picture: string })[]>("pictures", poses)) {
    const corners = findMarker(imageOf(picture));
    assert.ok(corners, `no marker from ${truth.place.join(" ")}`);
    const pose = poseOf(corners, EDGE_M / 2, PINHOLE);
    assert.ok(pose);
    const off = distance(cameraPlace(pose), truth.place) / Math.hypot(...truth.place);
    const turned = Math.max(degrees(pose.rotation[0]!, truth.right), degrees(pose.rotation[2]!, truth.back.map((value) => -value)));
    console.log(`from ${truth.place.join(" ")}: ${turned.toFixed(2)}°, ${(100 * off).toFixed(2)} %`);
    assert.ok(turned < 1 && off < 0.02);
  }
});

test("what is no marker is none", () => {
  const noise = new Uint8ClampedArray(4 * WIDTH * HEIGHT).map((_, i) => (i * 2654435761) >>> 24);
  assert.equal(findMarker({ data: noise, width: WIDTH, height: HEIGHT, colorSpace: "srgb" } as ImageData), undefined);
  assert.equal(poseOf([[10, 10], [10, 10], [10, 10], [10, 10]], 0.2, PINHOLE), undefined);
});

// ---------------------------------------------------------------- ground

/** Faces of one colour each, so that only the ground differs from texel to texel. */
const MAP: ReflectionMap = {
  sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size: 16, orientation: undefined,
  faces: [0, 1, 2, 3, 4, 5].map(() => Float32Array.from({ length: 3 * 256 }, (_, i) => [0.2, 0.5, 0.9][i % 3]!)),
};
const COEFFICIENTS = [1.5, 1.4, 1.3, 0.3, 0.2, 0.1, -0.3, 0.2, 0.1, 0.2, -0.2, 0.3];
const ESTIMATE = { lights: [], key: undefined, sh: { kind: "AMBIENT", order: 1, coefficients: COEFFICIENTS } } as unknown as Estimate;
const SIDE_M = 3, PROBE_M = 0.5, HEIGHT_M = 1.1, WHITE = 1, MOST_OFF = 2 / 255;

interface Expected { texels: number[][][]; seen: boolean[][]; picture: string; pose: Truth; albedo: number; byMap: number; radiance: number[][] }

test("the ground is sampled, scaled and mirrored as by lightprobe.local, within 2/255", { timeout: LONG_MS }, async () => {
  const browser = await launch();
  const page = await pageWith(browser, "ground.ts");
  const normals = Array.from({ length: 400 }, (_, i): Vec3 => {
    const z = 0.2 + (0.75 * (i + 0.5)) / 400, radius = Math.sqrt(1 - z * z);
    return [radius * Math.cos(i * 2.399963), radius * Math.sin(i * 2.399963), z];
  });
  // Plates as page/surface.ts lays them out: seen along −z, 64 in a row.
  const points = normals.map((_, i) => [(2 * ((i % 64) + 0.5)) / 64 - 1, (2 * (Math.floor(i / 64) + 0.5)) / 64 - 1 + HEIGHT_M, 0]);
  const towards = normals.map(([x, y, z]) => [2 * z * x, 2 * z * y, 2 * z * z - 1]);
  const wanted = table<Expected>("ground", { side: SIDE_M, probe: PROBE_M, map: { size: MAP.size, faces: MAP.faces.flatMap((face) => [...face]) }, coefficients: COEFFICIENTS, points, towards });
  const { right, up, back, place } = wanted.pose, rotation = [right, up.map((value) => -value), back.map((value) => -value)];
  const pose: Pose = { rotation, place: rotation.map((row) => -row.reduce((sum, value, i) => sum + value * place[i]!, 0)) };
  type Found = { rgba: number[]; albedo: number; byMap: number; colours: Vec3[] };
  const found = await page.evaluate((asked) => (window as unknown as { mirrored: (asked: unknown) => Found }).mirrored(asked),
    { picture: wanted.picture, pinhole: PINHOLE, pose, sideM: SIDE_M, map: MAP, estimate: ESTIMATE, probeM: PROBE_M, normals, heightM: HEIGHT_M, white: WHITE });
  await browser.close();
  let texel = 0, otherwise = 0;
  wanted.texels.flat().forEach((rgb, i) => {
    const isSeen = wanted.seen.flat()[i]!;
    if ((found.rgba[4 * i + 3]! > 0.5) !== isSeen) otherwise++;
    else if (isSeen) rgb.forEach((value, c) => { texel = Math.max(texel, Math.abs(value - found.rgba[4 * i + c]!)); });
  });
  const off = wanted.radiance.map((rgb, i) => Math.max(...rgb.map((value, c) => Math.abs(value - found.colours[i]![c]!))));
  const beyond = off.filter((value) => value > MOST_OFF).length;
  const groundly = wanted.radiance.filter((rgb) => Math.abs(rgb[2]! - 0.9) > 0.05).length;
  console.log(`texels ${(255 * texel).toFixed(2)}/255 off at most, ${otherwise} seen otherwise; factors ${found.albedo.toFixed(4)} and ${found.byMap.toFixed(4)} (${wanted.albedo.toFixed(4)}, ${wanted.byMap.toFixed(4)}); ${groundly} rays meet the ground, ${beyond} of ${off.length} are mirrored more than 2/255 off`);
  assert.ok(otherwise <= 5, `${otherwise} texels at the picture's edge`);
  assert.ok(texel <= 2 / 255);
  assert.ok(Math.abs(found.albedo / wanted.albedo - 1) < 0.01 && Math.abs(found.byMap / wanted.byMap - 1) < 0.01);
  assert.ok(groundly > 50);
  assert.ok(beyond <= 0.02 * off.length); // beside those few texels
});

// ---------------------------------------------------------------- the page

let daemon: ChildProcess, port = 0, folder = "";

before(async () => {
  folder = mkdtempSync(join(tmpdir(), "lp-ar-"));
  writeFileSync(join(folder, "room.pfm"), panorama());
  port = await freePort();
  daemon = spawn(DAEMON, [`--source=file:${join(folder, "room.pfm")}?rate=30`, `--publish=ws:127.0.0.1:${port}?root=${resolve(ROOT, "build/web")}`, "--reflection-map=32", "--ttl-ms=600000"], { stdio: ["ignore", "ignore", "inherit"] });
}, { timeout: LONG_MS });

after(() => { daemon?.kill(); });

async function overCamera(browser: Browser, query: string): Promise<{ page: Page; faults: string[] }> {
  const context = await browser.newContext({ viewport: { width: 480, height: 640 }, permissions: ["camera"] });
  const page = await context.newPage(), faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  await page.goto(`http://127.0.0.1:${port}/${query}`, { timeout: LONG_MS });
  await page.selectOption("#behind", "camera");
  return { page, faults };
}

test("the objects stand on the marker, and mirror the ground", { timeout: 3 * LONG_MS }, async () => {
  const film = join(folder, "table.y4m");
  execFileSync(resolve(ROOT, "build/venv/bin/python"), [resolve(ROOT, "clients/js/test/table.py"), "picture", film]);
  const [truth] = table<Truth[]>("pictures", [[0.5, 0.9, 1.3, 0.1, 0, -0.1]]);
  const browser = await launch("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream", `--use-file-for-fake-video-capture=${film}`);
  const { page, faults } = await overCamera(browser, "?fov=65");
  await page.waitForFunction(() => Number(document.body.dataset["ground"]) > 0, null, { timeout: LONG_MS });
  const matrix = (await page.evaluate(() => document.body.dataset["camera"]!)).split(" ").map(Number);
  assert.ok(distance(matrix.slice(12, 15), truth!.place) < 0.02 * Math.hypot(...truth!.place), `camera at ${matrix.slice(12, 15).join(" ")}`);
  assert.ok(degrees(matrix.slice(8, 11), truth!.back) < 1);
  assert.equal(await page.locator("#marker").isVisible(), false);
  await page.locator("#use-formulas").check();
  await page.locator("#use-ground").uncheck();
  await page.waitForFunction(() => document.body.dataset["ground"] === "", null, { timeout: LONG_MS });
  if (process.env["PICTURES"]) {
    await page.locator("#use-ground").check();
    await page.waitForTimeout(5000);
    await page.screenshot({ path: join(process.env["PICTURES"], "marker.png") });
  }
  await page.selectOption("#behind", "room");
  assert.deepEqual(faults, []);
  await browser.close();
});

test("without a marker in sight the page says what to do", { timeout: 3 * LONG_MS }, async () => {
  const browser = await launch("--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream");
  const { page, faults } = await overCamera(browser, "");
  await page.waitForFunction(() => !document.getElementById("marker")!.hidden, null, { timeout: LONG_MS });
  assert.match((await page.locator("#marker").textContent())!, /lightprobe align marker --print/);
  assert.deepEqual(faults, []);
  await browser.close();
});

test("in a WebXR session the objects stand in the room, by an emulated headset", { timeout: 3 * LONG_MS }, async () => {
  const browser = await launch(), page = await browser.newPage({ viewport: { width: 240, height: 320 } }), faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  const emulator = readFileSync(resolve(ROOT, "build/js/node_modules/iwer/build/iwer.min.js"), "utf8");
  // The emulator (2.5) gives a transform where its own code reads a matrix.
  const mend = "const { prototype } = XRReferenceSpace, offset = prototype.getOffsetReferenceSpace; prototype.getOffsetReferenceSpace = function (transform) { return offset.call(this, transform.matrix); };";
  await page.addInitScript(`${emulator}; window.headset = new IWER.XRDevice(IWER.metaQuest3); window.headset.installRuntime({ forceInstall: true }); ${mend}`);
  await page.goto(`http://127.0.0.1:${port}/`, { timeout: LONG_MS });
  await page.waitForFunction(() => Number(document.body.dataset["sequence"]) > 0, null, { timeout: LONG_MS });
  await page.waitForFunction(() => !document.getElementById("enter-room")!.hidden, null, { timeout: LONG_MS });
  await page.evaluate(() => document.getElementById("enter-room")!.click()); // not by mouse: that waits for frames, which are slow here
  type Headset = { headset: { activeSession?: XRSession; quaternion: { set(x: number, y: number, z: number, w: number): void } } };
  await page.waitForFunction(() => (window as unknown as Headset).headset.activeSession, null, { timeout: LONG_MS });
  /** Pixels drawn, and how far below the middle of the picture they lie on average, as a share of its height. */
  const seen = (): Promise<{ pixels: number; below: number }> => page.evaluate(() => new Promise((resolve) => {
    const session = (window as unknown as Headset).headset.activeSession!;
    let frames = 0;
    const read = (): void => {
      if (++frames < 5) return void session.requestAnimationFrame(read);
      const gl = (document.getElementById("view") as HTMLCanvasElement).getContext("webgl2")!, width = gl.drawingBufferWidth, height = gl.drawingBufferHeight;
      const codes = new Uint8Array(4 * width * height);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, codes);
      let pixels = 0, rows = 0;
      for (let k = 0; k < width * height; k++) {
        if (codes[4 * k + 3]! < 250) continue; // the room is seen there
        pixels += 1;
        rows += Math.floor(k / width);
      }
      resolve({ pixels, below: 0.5 - rows / Math.max(1, pixels) / height });
    };
    session.requestAnimationFrame(read);
  }));
  const ahead = await seen();
  await page.evaluate(() => { (window as unknown as Headset).headset.quaternion.set(0, 1, 0, 0); });
  const behind = await seen();
  await page.evaluate(() => { (window as unknown as Headset).headset.quaternion.set(0, 0, 0, 1); });
  console.log(`objects in the room: ${ahead.pixels} pixels ahead, ${(100 * ahead.below).toFixed(0)} % of the height below the middle; behind the user ${behind.pixels}`);
  assert.ok(ahead.pixels > 200 && ahead.below > 0.03);
  assert.equal(behind.pixels, 0);
  await page.evaluate(() => (window as unknown as Headset).headset.activeSession!.end());
  const after = Number(await page.evaluate(() => document.body.dataset["frames"]));
  await page.waitForFunction((before) => Number(document.body.dataset["frames"]) > before + 3, after, { timeout: LONG_MS });
  assert.deepEqual(faults, []);
  await browser.close();
});
