// SPDX-License-Identifier: Apache-2.0
/**
 * Pages of Babylon.js, A-Frame and <model-viewer> under lightprobe-webxr.js, with an emulated headset and a live daemon. Engines from npm
 * (tests/engines/webxr), so `make test-webxr` runs it and `make test-js` does not.
 */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { resolve } from "node:path";
import { after, afterEach, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { irradiance, type Estimate, type Vec3 } from "../src/index.js";
import { LONG_MS, launch } from "./chromium.js";
import { AXIS_COLOURS, LiveDaemon, axesPanorama } from "./daemon.js";
import { ROOT } from "./golden.js";
import { Pages, bundled, until, type Opened } from "./xr_pages.js";
import type { BallSample } from "./page/xr_ball.js";

const MODULES = resolve(ROOT, "build/webxr/node_modules"), MOST_OFF = 2 / 255;
const AXES: Vec3[] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
const pages = new Pages(), lamp = new LiveDaemon(), axes = new LiveDaemon();
let browser: Browser;

before(async () => {
  await pages.start();
  axes.picture = axesPanorama();
  const publish = (port: number): string => `ws:127.0.0.1:${port}?origins=${pages.origin}`;
  await Promise.all([lamp.start(publish), axes.start(publish)]);
  pages.serve("/aframe.js", readFileSync(resolve(MODULES, "aframe/dist/aframe-master.min.js"), "utf8"));
  pages.serve("/model-viewer.js", readFileSync(resolve(MODULES, "@google/model-viewer/dist/model-viewer.min.js"), "utf8"));
  pages.serve("/triangle.gltf", triangle());
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  for (const daemon of [lamp, axes]) daemon.kill();
  pages.stop();
});

afterEach(() => pages.close());

/** A triangle with normals, as glTF in one piece. */
function triangle(): string {
  const bytes = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 1]).buffer).toString("base64");
  const accessor = { componentType: 5126, count: 3, type: "VEC3" };
  return JSON.stringify({
    asset: { version: "2.0" }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }], meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1 } }] }],
    buffers: [{ byteLength: 72, uri: `data:application/octet-stream;base64,${bytes}` }], bufferViews: [{ buffer: 0, byteOffset: 0, byteLength: 36 }, { buffer: 0, byteOffset: 36, byteLength: 36 }],
    accessors: [{ ...accessor, bufferView: 0, min: [0, 0, 0], max: [1, 1, 0] }, { ...accessor, bufferView: 1 }],
  });
}

const AFRAME_SCENE = `<script src="aframe.js"></script><a-scene reflection="directionalLight: #main" xr-mode-ui="enabled: false">
  <a-light id="main" type="directional" intensity="0" color="white" position="0 1 0"></a-light>
  <a-sphere id="ball" radius="1" segments-width="192" segments-height="96" color="white" roughness="1" metalness="0"></a-sphere>
  <a-camera position="0 1.6 4"></a-camera></a-scene>`;
const MODEL = '<script type="module" src="model-viewer.js"></script><model-viewer src="triangle.gltf" ar ar-modes="webxr" xr-environment style="width:300px;height:300px"></model-viewer>';

interface Lit { daemon: LiveDaemon; exposure: number; script: string; body?: string; hash?: string }

async function litPage({ daemon, exposure, script, body = "", hash = "" }: Lit): Promise<Opened> {
  const opened = await pages.open(browser, { tag: `data-probe="ws://127.0.0.1:${daemon.port}/" data-exposure="${exposure}"`, body, hash, script: await bundled(script, { nodePaths: [MODULES] }) });
  try {
    await until(opened.page, "window.ready || document.querySelector('a-scene')?.renderStarted || document.querySelector('model-viewer')?.canActivateAR");
    await opened.page.evaluate(() => { (window as unknown as { enter(): void }).enter(); });
    await until(opened.page, "isLit()");
  } catch (error) {
    throw new Error([(error as Error).message, ...opened.faults, ...opened.said].join("\n"));
  }
  return opened;
}

const radiance = ({ page }: Opened, kind: string): Promise<BallSample[]> => page.evaluate((one) => (window as unknown as { radiance(kind: string): Promise<BallSample[]> }).radiance(one), kind);
const packet = ({ page }: Opened): Promise<Estimate> => page.evaluate(() => {
  const { lightprobeWebXR, headset } = window as unknown as { lightprobeWebXR: { of(session: unknown): { probe: { latest(): Estimate } } }; headset: { activeSession: unknown } };
  return lightprobeWebXR.of(headset.activeSession).probe.latest();
});

/** How far a white ball is off E(n)/π, and its brightest point. */
function compare(samples: BallSample[], estimate: Estimate, exposure: number): { worst: number; brightest: number } {
  const all = samples.flatMap(({ normal, radiance: found }) => irradiance(estimate, normal).map((value, c) => [(exposure * Math.max(0, value)) / Math.PI, found[c]!] as const));
  return { worst: Math.max(...all.map(([wanted, found]) => Math.abs(wanted - found))), brightest: Math.max(...all.map(([wanted]) => wanted)) };
}

const dot = (a: readonly number[], b: readonly number[]): number => a.reduce((sum, value, i) => sum + value * b[i]!, 0);

/** Of a mirror ball, along each axis, the colour; how far it is off the room's at most. */
function offAlongAxes(samples: BallSample[], exposure: number): number {
  const towards = ({ normal, view }: BallSample): number[] => normal.map((value, a) => 2 * dot(normal, view) * value - view[a]!);
  return Math.max(...AXES.flatMap((axis, i) => {
    const nearest = samples.reduce((best, one) => (dot(towards(one), axis) > dot(towards(best), axis) ? one : best));
    return nearest.radiance.map((value, c) => Math.abs(value - exposure * AXIS_COLOURS[i]![c]!));
  }));
}

for (const hash of ["#left", "#right"])
  test(`Babylon.js, ${hash.slice(1)}-handed: a white ball is E(n)/π, and a mirror shows the room where it is`, { timeout: 3 * LONG_MS }, async () => {
    const exposure = 0.1, white = await litPage({ daemon: lamp, exposure, script: "xr_babylon.js", hash }), estimate = await packet(white);
    const { worst, brightest } = compare(await radiance(white, "white"), estimate, exposure);
    console.log(`Babylon.js ${hash}: a white ball is ${(255 * worst).toFixed(2)}/255 off at most, its brightest point ${brightest.toFixed(2)}`);
    await pages.close();
    const mirror = await litPage({ daemon: axes, exposure: 0.9, script: "xr_babylon.js", hash }), off = offAlongAxes(await radiance(mirror, "mirror"), 0.9);
    console.log(`Babylon.js ${hash}: a mirror is ${off.toFixed(2)} off along the axes at most`);
    assert.ok(brightest > 0.2 && worst <= MOST_OFF, `${(255 * worst).toFixed(2)}/255 off`);
    assert.ok(off < 0.1, `${off} off`);
    assert.deepEqual([...white.faults, ...mirror.faults], []);
  });

test("Babylon.js: of a main light above 1, which it does not take, nothing is lost", { timeout: 3 * LONG_MS }, async () => {
  const opened = await litPage({ daemon: lamp, exposure: 0.3, script: "xr_babylon.js" }), estimate = await packet(opened);
  assert.ok(0.3 * Math.max(...estimate.lights[0]!.irradiance) > 1.5);
  const samples = await radiance(opened, "white"), { worst, brightest } = compare(samples, estimate, 0.3);
  const mean = samples.reduce((sum, { radiance: [, green] }) => sum + green, 0) / samples.length;
  const wanted = samples.reduce((sum, { normal }) => sum + (0.3 * irradiance(estimate, normal)[1]) / Math.PI, 0) / samples.length;
  console.log(`Babylon.js, main light 1.9: a white ball is ${(255 * worst).toFixed(1)}/255 off at most, its brightest point ${brightest.toFixed(2)}, ${(100 * (mean / wanted - 1)).toFixed(2)} % off in the mean`);
  assert.ok(worst < 0.05 && Math.abs(mean / wanted - 1) < 0.01);
});

test("A-Frame: `reflection` lights a white ball once, within its own approximation, and a mirror shows the room where it is", { timeout: 3 * LONG_MS }, async () => {
  const opened = await litPage({ daemon: axes, exposure: 0.9, script: "xr_aframe.js", body: AFRAME_SCENE }), estimate = await packet(opened);
  const { worst, brightest } = compare(await radiance(opened, "white"), estimate, 0.9), off = offAlongAxes(await radiance(opened, "mirror"), 0.9);
  console.log(`A-Frame: a white ball is ${(255 * worst).toFixed(1)}/255 off at most, its brightest point ${brightest.toFixed(2)}; a mirror is ${off.toFixed(2)} off along the axes`);
  assert.ok(worst < 0.1 * brightest && off < 0.1);
  assert.deepEqual(opened.faults, []);
});

test("<model-viewer>: the main light is the lamp, the environment is the room, and the ambient light is in it once", { timeout: 3 * LONG_MS }, async () => {
  const opened = await litPage({ daemon: lamp, exposure: 0.3, script: "xr_model.js", body: MODEL }), { lights: [listed] } = await packet(opened);
  type Lights = { direction: number[]; intensity: number; colour: number[]; sh: number[] };
  const { direction, intensity, colour, sh } = await opened.page.evaluate(() => (window as unknown as { lights(): Lights }).lights());
  assert.ok(dot(direction, listed!.direction) > 0.99999, String(direction));
  colour.forEach((value, c) => assert.ok(Math.abs(intensity * value - 0.3 * listed!.irradiance[c]!) < 0.01 * intensity));
  assert.deepEqual(sh, [0, 0, 0]);
  assert.deepEqual(opened.faults.filter((text) => !text.startsWith("Synthethic Environment Module required")), []); // the emulator alone has no hit test
});
