// SPDX-License-Identifier: Apache-2.0
/**
 * The components for react-three-fiber, A-Frame, Babylon.js and PlayCanvas in Chromium with a live daemon: a white ball against E(n)/π, a shadow, a mirror;
 * and the code of docs/users/first_light.md as it is printed.
 * Engines from npm (tests/engines/webxr), so `make test-components` runs it and `make test-js` does not.
 */
import assert from "node:assert/strict";
import { mkdtempSync, readFileSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, afterEach, before, test } from "node:test";
import type { Browser } from "playwright-core";
import { irradiance, type Estimate, type Vec3 } from "../src/index.js";
import { LONG_MS, launch } from "./chromium.js";
import { AXIS_COLOURS, LiveDaemon, axesPanorama, panorama } from "./daemon.js";
import { ROOT } from "./golden.js";
import { Pages, bundled, until, type Opened } from "./xr_pages.js";
import type { BallSample } from "./page/xr_ball.js";

const MODULES = resolve(ROOT, "build/webxr/node_modules"), MOST_OFF = 2 / 255;
const AXES: Vec3[] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
const pages = new Pages(), lamp = new LiveDaemon(), axes = new LiveDaemon(), aside = new LiveDaemon();
let browser: Browser;

before(async () => {
  await pages.start();
  axes.picture = axesPanorama();
  aside.picture = panorama(96); // its lamp is to the right
  const publish = (port: number): string => `ws:127.0.0.1:${port}?origins=${pages.origin}`;
  await Promise.all([lamp.start(publish), axes.start(publish), aside.start(publish)]);
  pages.serve("/aframe.js", readFileSync(resolve(MODULES, "aframe/dist/aframe-master.min.js"), "utf8"));
  pages.serve("/lightprobe-aframe.js", readFileSync(resolve(ROOT, "build/js/dist/lightprobe-aframe.js"), "utf8"));
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  for (const daemon of [lamp, axes, aside]) daemon.kill();
  pages.stop();
});

afterEach(() => pages.close());

interface Engine {
  script: string;
  body?: string;
  /** Of the page's address. */
  more?: string;
  /** Of a white ball whose ambient light comes from the reflection map: how far it may be off, as a share of the brightest. undefined: it has it from the SH. */
  mapOff?: number;
}

const ENGINES: Record<string, Engine> = {
  "react-three-fiber": { script: "part_react.js", mapOff: 0.1 },
  "A-Frame": { script: "part_aframe.js", body: '<script src="aframe.js"></script><script src="lightprobe-aframe.js"></script>', mapOff: 0.1 },
  "Babylon.js, left-handed": { script: "part_babylon.js" },
  "Babylon.js, right-handed": { script: "part_babylon.js", more: "&right=1" },
  "PlayCanvas": { script: "part_playcanvas.js" },
};

async function litPage({ script, body = "", more = "" }: Engine, daemon: LiveDaemon, exposure: number, reflections: boolean): Promise<Opened> {
  const hash = `#url=ws://127.0.0.1:${daemon.port}/&exposure=${exposure}&reflections=${reflections}${more}`;
  const opened = await pages.open(browser, { bare: true, body, hash, script: await bundled(script, { nodePaths: [MODULES], alias: { three: resolve(MODULES, "three") } }) });
  try {
    await until(opened.page, `window.part?.isReady() && (${!reflections} || part.hasMap())`);
  } catch (error) {
    throw new Error([(error as Error).message, ...opened.faults, ...opened.said].join("\n"));
  }
  return opened;
}

interface Part {
  radiance(kind: string): Promise<BallSample[]>;
  shadow(): Promise<{ shadow: Vec3; open: Vec3 }>;
  packet(): Estimate;
}

/** Calls a function of the page. */
const call = <K extends keyof Part>({ page }: Opened, name: K, ...all: string[]): Promise<Awaited<ReturnType<Part[K]>>> =>
  page.evaluate(([name, all]) => (window as unknown as { part: Record<string, (...all: string[]) => unknown> }).part[name]!(...all), [name, all] as const) as Promise<Awaited<ReturnType<Part[K]>>>;

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

for (const [name, engine] of Object.entries(ENGINES)) {
  test(`${name}: a white ball is E(n)/π, and its shadow has the ambient light alone`, { timeout: 3 * LONG_MS }, async () => {
    const exposure = 0.3, opened = await litPage(engine, lamp, exposure, false), estimate = await call(opened, "packet");
    const { worst, brightest } = compare(await call(opened, "radiance", "lambert"), estimate, exposure);
    const { shadow, open } = await call(opened, "shadow"), up: Vec3 = [0, 1, 0];
    const off = (found: Vec3, of: Estimate): number => Math.max(...irradiance(of, up).map((value, c) => Math.abs((exposure * value) / Math.PI - found[c]!)));
    const inShadow = off(shadow, { ...estimate, lights: [] }), beside = off(open, estimate);
    console.log(`${name}: a white ball is ${(255 * worst).toFixed(2)}/255 off at most, its brightest point ${brightest.toFixed(2)}; floor in the shadow ${(255 * inShadow).toFixed(2)}/255, beside it ${(255 * beside).toFixed(2)}/255`);
    assert.equal(estimate.lights.length, 1);
    assert.ok(brightest > 0.5 && brightest < 1, `the packet is no test: brightest ${brightest}`);
    assert.ok(worst <= MOST_OFF && inShadow <= MOST_OFF && beside <= MOST_OFF);
    assert.deepEqual(opened.faults, []);
  });

  test(`${name}: with reflections, a mirror shows the room where it is, and a white ball has the ambient light once`, { timeout: 3 * LONG_MS }, async () => {
    const exposure = 0.9, opened = await litPage(engine, axes, exposure, true), estimate = await call(opened, "packet");
    const mirror = offAlongAxes(await call(opened, "radiance", "mirror"), exposure);
    const { worst, brightest } = compare(await call(opened, "radiance", "standard"), estimate, exposure);
    console.log(`${name}: a mirror is ${mirror.toFixed(2)} off along the axes at most; a white ball with reflections ${(255 * worst).toFixed(2)}/255, its brightest point ${brightest.toFixed(2)}`);
    assert.ok(mirror < 0.1, `${mirror} off`);
    assert.ok(worst <= (engine.mapOff === undefined ? MOST_OFF : engine.mapOff * brightest), `${(255 * worst).toFixed(2)}/255 off`);
    assert.deepEqual(opened.faults, []);
  });
}

const PAGE = readFileSync(resolve(ROOT, "docs/users/first_light.md"), "utf8");

/** The one block of a part of the page, with the daemon's address. */
function block(title: string): string {
  const found = [...PAGE.split(`### ${title}\n`)[1]!.split("\n###")[0]!.matchAll(/```\w+\n(.*?)```/gs)];
  assert.equal(found.length, 1, `blocks of ${title}`);
  return found[0]![1]!.replace("ws://127.0.0.1:7701/", `ws://127.0.0.1:${aside.port}/`);
}

/** The page as printed, in a browser. */
async function printed(title: string): Promise<Opened> {
  const code = block(title);
  if (code.startsWith("<!doctype"))
    return pages.open(browser, { bare: true, script: "", body: code.replace("node_modules/aframe/dist/aframe-master.min.js", "aframe.js").replace("node_modules/lightprobe/dist/", "") });
  const file = join(mkdtempSync(join(tmpdir(), "lp-first-")), "main.jsx"), src = resolve(ROOT, "build/js/dist/src");
  writeFileSync(file, code);
  const alias = { three: resolve(MODULES, "three"), ...Object.fromEntries(["react", "babylon", "playcanvas"].map((name) => [`lightprobe/${name}`, join(src, `${name}.js`)])) };
  const script = await bundled(file, { nodePaths: [MODULES], alias, jsx: "automatic" });
  return pages.open(browser, { bare: true, script, body: title === "react-three-fiber" ? '<div id="view"></div>' : '<canvas id="view" width="512" height="512"></canvas>' });
}

/** Green of the ball on the right and on the left, in the picture that is drawn next. */
const sides = ({ page }: Opened): Promise<[number, number]> => page.evaluate(() => new Promise<[number, number]>((done) => requestAnimationFrame(() => {
  const canvas = document.querySelector("canvas"), small = new OffscreenCanvas(64, 64).getContext("2d")!;
  if (!canvas?.width) return done([0, 0]);
  const size = Math.min(canvas.width, canvas.height);
  small.drawImage(canvas, (canvas.width - size) / 2, (canvas.height - size) / 2, size, size, 0, 0, 64, 64);
  const at = (x: number, y: number): number => small.getImageData(x, y, 1, 1).data[1]!;
  done([at(38, 31), at(26, 31)]);
})));

for (const title of ["react-three-fiber", "A-Frame", "Babylon.js", "PlayCanvas"])
  test(`first_light.md, ${title}: the page shows a ball, lit from the right`, { timeout: 3 * LONG_MS }, async () => {
    const opened = await printed(title);
    let seen: [number, number] = [0, 0];
    for (const end = Date.now() + LONG_MS; Date.now() < end && !(seen[0] > 60 && seen[0] > 1.2 * seen[1]); await new Promise((done) => setTimeout(done, 50))) seen = await sides(opened);
    console.log(`first_light.md, ${title}: green of the ball ${String(seen)}`);
    assert.ok(seen[0] > 60 && seen[0] > 1.2 * seen[1], `right, left: ${String(seen)} ${opened.said.slice(0, 5).join()}`);
    assert.deepEqual(opened.faults, []);
  });
