// SPDX-License-Identifier: Apache-2.0
/** lightprobe-webxr.js in Chromium with an emulated headset and a live daemon: WebXR's light estimation as pages use it. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { after, afterEach, before, test } from "node:test";
import { gzipSync } from "node:zlib";
import type { Browser } from "playwright-core";
import { irradiance, meanIrradiance, type Estimate, type Vec3 } from "../src/index.js";
import { LONG_MS, launch } from "./chromium.js";
import { AXIS_COLOURS, LiveDaemon, axesPanorama } from "./daemon.js";
import { SHIM, Pages, bundled, until, type Opened } from "./xr_pages.js";
import type { BallSample } from "./page/xr_ball.js";

const MOST_OFF = 2 / 255, ASKS = { optionalFeatures: ["light-estimation"] };
const AXES: Vec3[] = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];

type Numbers = { sh: number[]; direction: number[]; intensity: number[]; atMs: number };
type Looked = { estimate: Estimate | null; state: string | undefined; frames: (Numbers | null)[]; changes: number };
type Mirrored = { colours: Vec3[]; kept: boolean; error: number };

let browser: Browser, plain = "", three = "";
const pages = new Pages(), lamp = new LiveDaemon(), axes = new LiveDaemon(), flaky = new LiveDaemon(), worn = new LiveDaemon();
const publish = (port: number): string => `ws:127.0.0.1:${port}?origins=${pages.origin}`;
const tag = (daemon: LiveDaemon, more = 'data-exposure="0.3"'): string => `data-probe="ws://127.0.0.1:${daemon.port}/" ${more}`;

before(async () => {
  await pages.start();
  axes.picture = worn.picture = axesPanorama();
  await Promise.all([lamp.start(publish), axes.start(publish), flaky.start(publish)]);
  flaky.kill();
  [plain, three] = await Promise.all([bundled("xr_plain.ts"), bundled("xr_three.ts")]);
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  for (const daemon of [lamp, axes, flaky, worn]) daemon.kill();
  pages.stop();
});

afterEach(() => pages.close());

/** Calls a function of the page; its frames go on meanwhile. */
const call = <T>({ page }: Opened, name: string, ...all: unknown[]): Promise<T> =>
  page.evaluate(([name, all]) => (window as unknown as Record<string, (...all: unknown[]) => unknown>)[name]!(...all), [name, all] as const) as Promise<T>;

/** Looks until something is so. */
async function lookUntil(opened: Opened, is: (looked: Looked) => boolean): Promise<Looked> {
  const frames: (Numbers | null)[] = [];
  for (const end = Date.now() + LONG_MS; Date.now() < end; await new Promise((done) => setTimeout(done, 50))) {
    const looked = await call<Looked>(opened, "look");
    frames.push(...looked.frames);
    if (is({ ...looked, frames })) return { ...looked, frames };
  }
  throw new Error(`never: ${is.toString()}; ${JSON.stringify(await call(opened, "look")).slice(0, 300)} ${opened.said.join("\n")}`);
}

const NORMALS: Vec3[] = Array.from({ length: 60 }, (_, i) => {
  const y = 1 - (2 * (i + 0.5)) / 60, radius = Math.sqrt(1 - y * y);
  return [radius * Math.cos(i * 2.399963), y, radius * Math.sin(i * 2.399963)];
});

const shownAt = ({ sh, direction, intensity }: Numbers): number[] =>
  NORMALS.flatMap((n) => irradiance({ sh: { kind: "AMBIENT", order: 2, coefficients: sh }, lights: [{ direction, irradiance: intensity }] } as unknown as Estimate, n));
const change = (a: number[], b: number[]): number => Math.max(...a.map((value, i) => Math.abs(value - b[i]!)));

/** Looks until the frames show the packet that the page has, times `gain` where it is given: the shim fades, and on a busy machine a new packet may come in the midst of it. */
async function lookUntilShown(opened: Opened, gain: (estimate: Estimate) => number): Promise<Looked> {
  return lookUntil(opened, ({ frames, estimate }) => {
    const shown = frames.filter((one) => one !== null).at(-1);
    if (!shown || !estimate) return false;
    const wanted = NORMALS.flatMap((n) => irradiance(estimate, n).map((value) => gain(estimate) * value));
    return change(shownAt(shown), wanted) < 0.01 * Math.max(...wanted);
  });
}

const hasFrames = ({ frames }: Looked): boolean => frames.some((frame) => frame !== null);
/** A direction of the session in the axes of a probe whose −Z is turned to the left by 90°. */
const toLeft = ([x, y, z]: Vec3): Vec3 => [-z, y, x];

// ---------------------------------------------------------------- three.js

async function throughThree(daemon: LiveDaemon, more: string, hash = ""): Promise<Opened> {
  const opened = await pages.open(browser, { tag: tag(daemon, more), script: three, hash });
  await until(opened.page, "document.getElementById('ARButton')?.textContent === 'START AR'");
  await opened.page.evaluate(() => document.getElementById("ARButton")!.click());
  await until(opened.page, "window.told.includes('start') && seen() > 3");
  return opened;
}

/** The newest packet of the page's session. */
const packet = ({ page }: Opened): Promise<Estimate> => page.evaluate(() => {
  const { lightprobeWebXR, headset } = window as unknown as { lightprobeWebXR: { of(session: unknown): { probe: { latest(): Estimate } } }; headset: { activeSession: unknown } };
  return lightprobeWebXR.of(headset.activeSession).probe.latest();
});

/** How far a white ball is off E(n)/π of a packet times `gain`, where the brightest is below white. */
function compare(samples: BallSample[], estimate: Estimate, toProbe: (normal: Vec3) => Vec3, gain: number): { worst: number; brightest: number } {
  let worst = 0, brightest = 0;
  for (const { normal, radiance } of samples)
    irradiance(estimate, toProbe(normal)).forEach((value, c) => {
      const wanted = (gain * Math.max(0, value)) / Math.PI;
      brightest = Math.max(brightest, wanted);
      worst = Math.max(worst, Math.abs(wanted - radiance[c]!));
    });
  return { worst, brightest };
}

for (const [how, more, toProbe] of [["as the probe stands", "", (n: Vec3) => n], ["turned by data-yaw", 'data-yaw="90"', toLeft]] as const)
  test(`three.js: a white ball of XREstimatedLight is E(n)/π, ${how}`, { timeout: 2 * LONG_MS }, async () => {
    const opened = await throughThree(lamp, `data-exposure="0.3" ${more}`), estimate = await packet(opened);
    assert.equal(estimate.lights.length, 1);
    const { worst, brightest } = compare(await call<BallSample[]>(opened, "radiance", "lambert"), estimate, toProbe, 0.3);
    console.log(`three.js, ${how}: a white ball is ${(255 * worst).toFixed(2)}/255 off at most, its brightest point ${brightest.toFixed(2)}`);
    assert.ok(brightest > 0.5 && brightest < 1, `the packet is no test: brightest ${brightest}`);
    assert.ok(worst <= MOST_OFF, `${(255 * worst).toFixed(2)}/255 off`);
    assert.deepEqual(opened.faults, []);
    });

test("three.js: with the cube map as the environment a white ball has the ambient light once, and a mirror shows the room where it is", { timeout: 2 * LONG_MS }, async () => {
  const opened = await throughThree(axes, 'data-exposure="0.9"', "#environment"), estimate = await packet(opened);
  await until(opened.page, "xrLight.lightProbe.sh.coefficients[0].x === 0"); // the map has come
  const { worst, brightest } = compare(await call<BallSample[]>(opened, "radiance", "standard"), estimate, (n) => n, 0.9);
  console.log(`three.js with the cube map alone: a physical white ball is ${(255 * worst).toFixed(1)}/255 off at most, its brightest point ${brightest.toFixed(2)}`);
  assert.ok(worst < 0.1 * brightest, "its own approximation of a rough ball, at 16 texels"); // twice the light would be 100 % off
  const mirror = await call<BallSample[]>(opened, "radiance", "mirror");
  AXES.forEach((axis, i) => {
    const { radiance } = nearestTo(mirror, axis);
    radiance.forEach((value, c) => assert.ok(Math.abs(value - 0.9 * AXIS_COLOURS[i]![c]!) < 0.1, `along ${String(axis)}: ${String(radiance)}, expected 0.9 × ${String(AXIS_COLOURS[i])}`));
  });
  assert.deepEqual(opened.faults, []);
});

/** The sample whose mirror image lies nearest to a direction. */
function nearestTo(samples: BallSample[], axis: Vec3): BallSample {
  const dot = (a: readonly number[], b: readonly number[]): number => a.reduce((sum, value, i) => sum + value * b[i]!, 0);
  const cosine = ({ normal, view }: BallSample): number => dot(normal.map((value, a) => 2 * dot(normal, view) * value - view[a]!), axis);
  return samples.reduce((best, one) => (cosine(one) > cosine(best) ? one : best));
}

// ---------------------------------------------------------------- the specification

test("a page gets WebXR's objects: granted, asked, estimated; the light comes from where the lamp is", { timeout: 2 * LONG_MS }, async () => {
  const opened = await pages.open(browser, { tag: tag(lamp), script: plain });
  assert.deepEqual(opened.sockets, [], "connected before anybody asked");
  for (const init of [ASKS, { requiredFeatures: ["light-estimation", "local-floor"] }]) {
    const found = await call<{ enabled: string[]; preferred: string; type: string }>(opened, "start", init, "rgba16f");
    assert.ok(found.enabled.includes("light-estimation"), found.enabled.join());
    assert.equal(found.preferred, "rgba16f");
    const { frames, estimate } = await lookUntil(opened, hasFrames), shown = frames.at(-1)!;
    assert.equal(shown.sh.length, 27);
    const off = shown.direction.map((value, a) => Math.abs(value - estimate!.lights[0]!.direction[a]!));
    assert.ok(Math.max(...off) < 1e-4 && Math.abs(shown.direction[1]! - Math.SQRT1_2) < 0.05 && shown.direction[2]! < -0.6, String(shown.direction));
    shown.intensity.forEach((value, c) => assert.ok(Math.abs(value - 0.3 * estimate!.lights[0]!.irradiance[c]!) < 1e-3 * value));
    await call(opened, "end");
  }
  assert.equal(opened.sockets.length, 2, "one connection for each of two sessions");
  assert.deepEqual(await call(opened, "wrongs"), {
    "a session that did not ask": "NotSupportedError", "no such format": "TypeError", "a session that has ended": "InvalidStateError",
    "a map of another session": "InvalidStateError", "an estimate of another session": "InvalidStateError", "what is no probe": "TypeError",
  });
  assert.deepEqual(opened.faults, []);
});

for (const [format, more, toProbe, most] of [["rgba16f", "", (d: Vec3) => d, 0.01], ["srgba8", "", (d: Vec3) => d, 0.02], ["rgba16f", 'data-yaw="90"', toLeft, 0.01]] as const)
  test(`the reflection cube map shows each axis' own colour: ${format} ${more}`, { timeout: 2 * LONG_MS }, async () => {
    const opened = await pages.open(browser, { tag: tag(axes, `data-exposure="0.9" ${more}`), script: plain });
    await call(opened, "start", ASKS, format);
    await lookUntil(opened, (looked) => hasFrames(looked) && looked.changes > 0);
    const found = await call<Mirrored>(opened, "mirrored", AXES);
    AXES.forEach((axis, i) => {
      const inProbe = toProbe(axis), colour = AXIS_COLOURS[AXES.findIndex((one) => one.every((value, a) => value === Math.round(inProbe[a]!)))]!;
      found.colours[i]!.forEach((value, c) => assert.ok(Math.abs(value - 0.9 * colour[c]!) < most, `along ${String(axis)}: ${String(found.colours[i])}, expected 0.9 × ${String(colour)}`));
    });
    assert.ok(found.kept, "the page's WebGL state has changed");
    assert.equal(found.error, 0);
    assert.deepEqual(opened.faults, []);
    });

test("a probe on a head that is turned to the left: poses are sent, and light comes in the session's axes", { timeout: 2 * LONG_MS }, async () => {
  await worn.start(publish, "--orientation=client");
  const opened = await pages.open(browser, { tag: tag(worn, 'data-exposure="0.9" data-mount="head"'), script: plain });
  await opened.page.evaluate(() => { (window as unknown as { headset: { quaternion: { set(...xyzw: number[]): void } } }).headset.quaternion.set(0, Math.SQRT1_2, 0, Math.SQRT1_2); });
  await call(opened, "start", ASKS, "rgba16f");
  const before = (await lookUntil(opened, ({ estimate }) => estimate?.frame === "WORLD")).changes;
  await lookUntil(opened, ({ frames, changes }) => changes > before || frames.length > 60);
  await lookUntilShown(opened, () => 0.9);
  const found = await call<Mirrored>(opened, "mirrored", AXES);
  AXES.forEach((axis, i) => {
    const inProbe = toLeft(axis), colour = AXIS_COLOURS[AXES.findIndex((one) => one.every((value, a) => value === inProbe[a]! + 0))]!;
    found.colours[i]!.forEach((value, c) => assert.ok(Math.abs(value - 0.9 * colour[c]!) < 0.02, `along ${String(axis)}: ${String(found.colours[i])}, expected 0.9 × ${String(colour)}`));
  });
  assert.deepEqual(opened.faults, []);
});

// ---------------------------------------------------------------- what goes wrong

/** The largest change of E(n) from one frame to the next, and from the first to the last. */
function changes(frames: (Numbers | null)[]): { step: number; whole: number; count: number } {
  const shown = frames.filter((one) => one !== null).map(shownAt);
  return { step: Math.max(...shown.slice(1).map((one, i) => change(one, shown[i]!))), whole: change(shown[0]!, shown.at(-1)!), count: shown.length };
}

test("a probe that comes late, goes, and comes back with another boot: null until it is there, then no frame is dark or leaps", { timeout: 4 * LONG_MS }, async () => {
  const opened = await pages.open(browser, { tag: tag(flaky), script: plain });
  await call(opened, "start", ASKS, "rgba16f");
  const early = await lookUntil(opened, ({ frames }) => frames.length > 5);
  assert.ok(early.frames.every((one) => one === null), "light before there is a probe");
  assert.equal(await call(opened, "mirrored", AXES), undefined);
  await flaky.start(publish, "--ttl-ms=700");
  const first = await lookUntil(opened, (looked) => hasFrames(looked) && looked.changes > 0), bootId = first.estimate!.bootId;
  await call(opened, "look");
  flaky.kill();
  const gone = await lookUntil(opened, ({ estimate, frames }) => estimate === null && frames.filter(Boolean).at(-1)!.intensity[0]! < 1e-3);
  assert.ok(gone.frames.every((one) => one !== null), "a frame without light");
  const away = changes(gone.frames), last = gone.frames.at(-1)!;
  assert.ok(last.sh[3]! > 0 && last.sh[0]! > 0, "the neutral light is not from above");
  console.log(`the probe goes: E changes by ${away.whole.toFixed(2)}, in ${away.count} frames, by ${away.step.toFixed(2)} at most from one to the next`);
  assert.ok(away.whole > 0.3 && away.step < 0.75 * away.whole);
  flaky.picture = axesPanorama(); // it stands elsewhere now
  await flaky.start(publish, "--ttl-ms=600000");
  const back = await lookUntil(opened, ({ estimate }) => estimate !== null && estimate.bootId !== bootId);
  const settled = await lookUntilShown(opened, () => 0.3);
  assert.equal(settled.estimate!.bootId, back.estimate!.bootId);
  const there = changes([...back.frames, ...settled.frames]);
  assert.ok(there.step < 0.75 * there.whole, `${there.step} of ${there.whole}`);
  assert.deepEqual(opened.faults, []);
});

test("a page that asks once a second has the light, as bright as a page shows it", { timeout: 2 * LONG_MS }, async () => {
  const opened = await pages.open(browser, { tag: tag(lamp, ""), script: plain });
  await call(opened, "start", ASKS, "rgba16f", 1000);
  await lookUntilShown(opened, (estimate) => Math.PI / 2 / meanIrradiance(estimate));
});

test("a page that never asks connects to nothing, and its session is the browser's own", { timeout: 2 * LONG_MS }, async () => {
  const opened = await pages.open(browser, { tag: tag(lamp), script: plain });
  const { enabled } = await call<{ enabled: string[] }>(opened, "start", { optionalFeatures: ["local-floor"] });
  assert.ok(!enabled.includes("light-estimation"));
  await opened.page.waitForTimeout(300);
  assert.deepEqual([opened.sockets, opened.faults], [[], []]);
});

test("a browser without WebXR, one without a headset, and attributes that say nothing", { timeout: 2 * LONG_MS }, async () => {
  const insecure = await launch("--host-resolver-rules=MAP app.example 127.0.0.1");
  const without = await pages.open(insecure, { tag: tag(lamp), script: "", bare: true, host: "app.example" });
  assert.equal(await without.page.evaluate(() => "xr" in navigator), false, "this page has WebXR");
  assert.deepEqual([without.faults, without.said, without.sockets], [[], [], []]);
  await insecure.close();
  const bare = await pages.open(browser, { tag: tag(lamp), script: "", bare: true });
  const refused = await bare.page.evaluate(() => navigator.xr!.requestSession("immersive-ar", { requiredFeatures: ["light-estimation"] }).then(() => "a session", (error: Error) => error.name));
  assert.notEqual(refused, "a session");
  assert.deepEqual([bare.faults, bare.sockets], [[], []]);
  const odd = await pages.open(browser, { tag: 'data-probe="ftp://x/&quot;><b>" data-yaw="much"', script: plain });
  assert.equal(odd.said.filter((line) => line.startsWith("lightprobe: ftp:")).length, 1, odd.said.join("\n"));
  const half = await pages.open(browser, { tag: tag(lamp, 'data-yaw="much" data-exposure="-1" data-mount="hat"'), script: plain });
  await call(half, "start", ASKS, "rgba16f");
  await lookUntil(half, hasFrames);
  assert.deepEqual(["data-yaw", "data-exposure", "data-mount"].map((name) => half.said.filter((line) => line.includes(name)).length), [1, 1, 1], half.said.join("\n"));
  assert.deepEqual([odd.faults, half.faults], [[], []]);
});

test("the script has at most 40 kB, gzipped", () => {
  const bytes = gzipSync(readFileSync(SHIM), { level: 9 }).length;
  console.log(`lightprobe-webxr.js: ${(bytes / 1000).toFixed(1)} kB gzipped`);
  assert.ok(bytes <= 40_000);
});
