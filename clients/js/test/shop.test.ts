// SPDX-License-Identifier: Apache-2.0
/** The viewer as people first see it: scenes, comparison, dropped files, shading terms, light and dark, and how large it is. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync, readdirSync } from "node:fs";
import { join, resolve } from "node:path";
import { test } from "node:test";
import { gzipSync } from "node:zlib";
import { fromBinary, toBinary } from "@bufbuild/protobuf";
import type { Page } from "playwright-core";
import * as pb from "../src/gen/lightprobe_pb.js";
import { EstimateFlag, irradiance, luminance, meanIrradiance, type Vec3 } from "../src/index.js";
import { SURFACES } from "../web/materials.js";
import { mainLightAndAmbient } from "../web/plain_light.js";
import { TERMS, atNormalOf, withTerm } from "../web/terms.js";
import { LONG_MS, NIGHTLY, launch } from "./chromium.js";
import { WEB, panorama } from "./daemon.js";
import { redCube } from "./gltf.js";
import { ROOT } from "./golden.js";
import { estimate, lamp } from "./lights.js";
import { live } from "./live.js";

const session = live();
session.daemon.picture = twoLamps();

/** The room of {@link panorama} with a second lamp, to the right. */
function twoLamps(): Buffer {
  const one = panorama(), other = panorama(100), start = one.length - 4 * 3 * 128 * 64; // floats follow the header, unaligned
  for (let at = start; at < one.length; at += 4) one.writeFloatLE(Math.max(one.readFloatLE(at), other.readFloatLE(at)), at);
  return one;
}

const MOST_BYTES = 900_000;

test("the page is at most 900 kB, compressed, with all that it loads", () => {
  const files = readdirSync(WEB).filter((name) => /^(index\.html|main\.js|reader\.js|style\.css)$/.test(name));
  assert.equal(files.length, 4);
  const bytes = files.reduce((sum, name) => sum + gzipSync(readFileSync(join(WEB, name))).length, 0);
  console.log(`the viewer, by gzip: ${(bytes / 1000).toFixed(0)} kB`);
  assert.ok(bytes <= MOST_BYTES, `${bytes} bytes`);
});

test("one main light and ambient: the strongest lamp, and all other light as its mean", () => {
  const whole = { ...estimate([lamp(1, [0, 1, 0]), { ...lamp(2, [1, 0, 0]), irradiance: [9, 8, 7] as Vec3 }]), sh: { kind: "AMBIENT" as const, order: 1, coefficients: [2, 2, 2, 1, 1, 1, 0, 0, 0, 0, 0, 0] } };
  const plain = mainLightAndAmbient(whole);
  assert.deepEqual(plain.lights.map(({ id, angularRadiusDeg }) => [id, angularRadiusDeg]), [[2, 0]]);
  assert.ok(Math.abs(meanIrradiance(plain) / meanIrradiance(whole) - 1) < 1e-9);
  const away = ([[0, 1, 0], [0, -1, 0], [0, 0, 1]] as Vec3[]).map((normal) => luminance(irradiance(plain, normal)));
  away.forEach((value) => assert.ok(Math.abs(value / away[0]! - 1) < 1e-9, "ambient light is not the same from everywhere"));
});

test("each shading term is of a surface what its name says", () => {
  const settings = { nu: 80, nv: 5, index: 1.5 };
  assert.ok(Math.abs(atNormalOf(1.5) - 0.04) < 1e-12);
  for (const [name, surface] of Object.entries(SURFACES)) {
    assert.equal(withTerm(surface, "material", settings), surface);
    const shown = Object.fromEntries(TERMS.map((term) => [term, withTerm(surface, term, settings)]));
    assert.deepEqual([shown["lambert"]!.highlight, shown["lambert"]!.reflection, shown["lambert"]!.refraction], ["none", 0, 0], name);
    assert.ok(Math.max(...shown["lambert"]!.albedo) > 0.3, `${name} is black by Lambert's term`);
    assert.deepEqual([shown["premoze"]!.highlight, shown["premoze"]!.powers], ["premoze", [80, 5]]);
    assert.deepEqual([shown["refraction"]!.indexRatio, shown["refraction"]!.reflection], [1 / 1.5, 0]);
    assert.deepEqual([shown["fresnel"]!.reflection, shown["fresnel"]!.refraction], [1, 1]);
  }
});

// ---------------------------------------------------------------- the page

interface Looks { width?: number; height?: number; colorScheme?: "light" | "dark"; route?: (page: Page) => Promise<void> }

async function viewer({ width = 360, height = 640, colorScheme = "dark", route = async () => {} }: Looks = {}): Promise<{ page: Page; faults: string[] }> {
  const page = await session.browser.newPage({ viewport: { width, height }, reducedMotion: "reduce", colorScheme }), faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  page.on("console", (message) => { if (message.type() === "error") faults.push(message.text()); });
  await route(page);
  await page.goto(`http://127.0.0.1:${session.daemon.port}/`, { timeout: LONG_MS });
  await page.waitForFunction(() => Number(document.body.dataset["frames"]) > 3 && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  return { page, faults };
}

/** Red, green and blue of the left and of the right half of the picture, in 16 × 32 pixels each, once `frames` more are drawn. */
async function halves(page: Page, frames = 4): Promise<[number[], number[]]> {
  const drawn = await page.evaluate(() => Number(document.body.dataset["frames"]));
  await page.waitForFunction((wanted) => Number(document.body.dataset["frames"]) > wanted, drawn + frames, { timeout: LONG_MS });
  return page.evaluate(() => {
    const small = new OffscreenCanvas(32, 32).getContext("2d")!;
    small.drawImage(document.querySelector<HTMLCanvasElement>("#view")!, 0, 0, 32, 32);
    return [0, 16].map((left) => [...small.getImageData(left, 0, 16, 32).data].filter((_, i) => i % 4 < 3)) as [number[], number[]];
  });
}

/** How many values differ by more than `least`, of 255. */
const different = (one: number[], other: number[], least = 10): number => one.filter((value, i) => Math.abs(value - other[i]!) > least).length;

/** The picture once what was asked for is drawn, and it does not change by itself. */
async function settled(page: Page): Promise<[number[], number[]]> {
  const drawn = await page.evaluate(() => Number(document.body.dataset["frames"]));
  await page.waitForFunction((wanted) => Number(document.body.dataset["frames"]) > wanted, drawn + 2, { timeout: LONG_MS });
  let before = await halves(page), still = await halves(page);
  for (let i = 0; i < 20 && different(before.flat(), still.flat()) > 4; i++) [before, still] = [still, await halves(page)];
  return still;
}

/** Drops a file on the picture, as the browser tells the page. */
const drop = (page: Page, name: string, data: Buffer): Promise<boolean> => page.evaluate(([name, base64]) => {
  const transfer = new DataTransfer(), view = document.getElementById("view")!;
  transfer.items.add(new File([Uint8Array.from(atob(base64!), (c) => c.charCodeAt(0))], name!));
  const send = (kind: string): boolean => view.dispatchEvent(new DragEvent(kind, { dataTransfer: transfer, bubbles: true, cancelable: true }));
  send("dragenter");
  const isInvited = !document.getElementById("drop")!.hidden;
  send("dragover");
  send("drop");
  return isInvited && document.getElementById("drop")!.hidden === true;
}, [name, data.toString("base64")]);

test("behind the line the same objects stand in one main light and ambient, and the line moves by the keyboard", { timeout: 6 * LONG_MS }, async () => {
  const { page, faults } = await viewer();
  const [left, right] = await settled(page);
  await page.keyboard.press("b");
  assert.ok(await page.locator("#split").isVisible());
  const [probe, plain] = await settled(page);
  assert.equal(await page.locator("#right").textContent(), "one main light and ambient");
// The test room is lit much like that, by a lamp and grey walls: ambient light that is the same from everywhere is a little too blue or too red.
  const [kept, changed] = [different(left, probe, 3), different(right, plain, 3)];
  assert.ok(kept < 20 && changed > 50, `left ${kept}, right ${changed} of ${left.length} values differ`);
  const at = (): Promise<number> => page.evaluate(() => parseFloat(document.getElementById("line")!.style.left));
  const before = await at();
  await page.locator("#split").focus();
  for (let i = 0; i < 10; i++) await page.keyboard.press("ArrowRight");
  assert.ok(await at() > before + 5, `${await at()} %, before ${before} %`);
  await page.keyboard.press("b");
  assert.equal(await page.locator("#split").isVisible(), false);
  assert.deepEqual(faults, []);
  await page.close();
});

test("scenes, what is behind, and the shading terms change the picture; sliders are there for the terms that have them", { timeout: 8 * LONG_MS, ...NIGHTLY }, async () => {
  const { page, faults } = await viewer();
  let before = (await settled(page)).flat();
  const changes = async (what: string): Promise<void> => {
    const now = (await settled(page)).flat(), count = different(before, now);
    assert.ok(count > 20, `${what}: only ${count} values change`);
    before = now;
  };
  await page.selectOption("#behind", "plain");
  await changes("plain");
  await page.selectOption("#scene", "spheres");
  await changes("spheres");
  assert.equal(await page.locator("#term").isVisible(), false);
  await page.keyboard.press("f");
  const sliders = (): Promise<string[]> => page.evaluate(() => [...document.querySelectorAll<HTMLElement>("#shading [id^=row-]")].filter((row) => row.offsetParent).map((row) => row.id));
  assert.deepEqual(await sliders(), []);
  await page.selectOption("#term", "ashikhmin-shirley");
  assert.deepEqual(await sliders(), ["row-nu", "row-nv"]);
  await changes("Ashikhmin–Shirley");
  await page.locator("#set-nu").fill("0");
  await page.locator("#set-nv").fill("0");
  assert.equal(await page.locator("#out-nu").textContent(), "1");
  await changes("exponents of 1");
  await page.selectOption("#term", "refraction");
  assert.deepEqual(await sliders(), ["row-index"]);
  await changes("refraction");
  assert.deepEqual(faults, []);
  await page.close();
});

test("a dropped object is shown; what the page cannot show, it says", { timeout: 6 * LONG_MS, ...NIGHTLY }, async () => {
  const { page, faults } = await viewer(), before = (await settled(page)).flat();
  assert.ok(await drop(page, "notes.txt", Buffer.from("text")), "no invitation while a file is over the page");
  await page.waitForFunction(() => /notes\.txt: .*objects \(\.glb\) and plays recordings/.test(document.getElementById("problem")!.textContent!), null, { timeout: LONG_MS });
  await drop(page, "cube.glb", redCube());
  await page.waitForFunction(() => document.getElementById("problem")!.hidden, null, { timeout: LONG_MS });
  assert.equal(await page.locator("#scene").inputValue(), "loaded");
  assert.ok(different(before, (await settled(page)).flat()) > 60);
  assert.deepEqual(faults, []);
  await page.close();
});

test("a dropped recording lights the objects, also when the probe is gone; a spoilt one leaves the probe", { timeout: 6 * LONG_MS }, async () => {
  const { daemon } = session, file = join(daemon.folder, "room.mcap");
  execFileSync(resolve(ROOT, "build/venv/bin/lightprobe"), ["record", file, "--from", `ws:127.0.0.1:${daemon.port}`, "--seconds", "1.5"], { stdio: "ignore" });
  const { page, faults } = await viewer();
  await drop(page, "bad.mcap", Buffer.from("no recording"));
  await page.waitForFunction(() => /bad\.mcap: .*record one with `lightprobe record`: the probe's light stays/.test(document.getElementById("problem")!.textContent!), null, { timeout: LONG_MS });
  assert.equal(await page.locator("#left").textContent(), "lit by the probe");
  daemon.kill();
  await drop(page, "room.mcap", readFileSync(file));
  await page.waitForFunction(() => document.getElementById("left")!.textContent === "lit by the recording" && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  assert.equal(await page.locator("#status").textContent(), "recording room.mcap");
  assert.ok(Number(await page.evaluate(() => document.body.dataset["sequence"])) > 0);
  assert.ok(await page.locator("#order").isDisabled(), "asks a recording for something else");
  await page.waitForTimeout(3000); // longer than it is
  assert.equal(await page.locator("#left").textContent(), "lit by the recording");
  assert.deepEqual(faults.filter((text) => !/WebSocket/.test(text)), []);
  await page.close();
  await daemon.start();
});

test("a recording has no truth beside it", { timeout: 3 * LONG_MS }, async () => {
  const { daemon } = session, file = join(daemon.folder, "untrue.mcap"), here = `127.0.0.1:${daemon.port}`;
  execFileSync(resolve(ROOT, "build/venv/bin/lightprobe"), ["record", file, "--from", `ws:${here}`, "--seconds", "1"], { stdio: "ignore" });
  const plain = await launch("--disable-3d-apis"), page = await plain.newPage(); // the picture would take its time
  await page.goto(`http://${here}/?truth=ws://${here}/`, { timeout: LONG_MS });
  const ofTruth = (): Promise<boolean[]> => page.evaluate(() => {
    const box = document.querySelector<HTMLInputElement>("#use-truth")!;
    return [box.checked, !box.disabled, !document.querySelector<HTMLElement>("#legend .truth")!.hidden, /white sphere/.test(document.getElementById("figures")!.textContent!)];
  });
  await page.waitForFunction(() => /white sphere/.test(document.getElementById("figures")!.textContent!), null, { timeout: LONG_MS });
  assert.deepEqual(await ofTruth(), [true, true, true, true]);
  await drop(page, "untrue.mcap", readFileSync(file));
  await page.waitForFunction(() => document.getElementById("left")!.textContent === "lit by the recording" && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  await page.waitForTimeout(500); // figures are written a few times a second
  assert.deepEqual(await ofTruth(), [false, false, false, false]);
  assert.match(await page.locator("label:has(#use-truth)").getAttribute("title") ?? "", /no truth beside it: reload/);
  await plain.close();
});

test("flags are said in words, with what to do", { timeout: 2 * LONG_MS, ...NIGHTLY }, async () => {
  const { page } = await viewer({ route: (unconnected) => unconnected.routeWebSocket(/./, (socket) => {
    const probe = socket.connectToServer();
    probe.onMessage((data) => {
      const whole = fromBinary(pb.FromProbeSchema, data as Buffer);
      if (whole.message.case === "estimate") whole.message.value.flags = EstimateFlag.UNDEREXPOSED | EstimateFlag.FILM_TURNED;
      socket.send(Buffer.from(toBinary(pb.FromProbeSchema, whole)));
    });
  }) });
  assert.deepEqual(await page.locator("#faults li").allTextContents(), [
    "UNDEREXPOSED: most of the picture is below the noise; use longer exposures or more gain", "FILM_TURNED: the polarizing film is a quarter turn off; turn it by 90°",
  ]);
  await page.close();
});

for (const colorScheme of ["light", "dark"] as const)
  test(`at 360 px, ${colorScheme}: nothing is wider than the page, text is readable, and every control has a name`, { timeout: 3 * LONG_MS, ...(colorScheme === "light" ? NIGHTLY : {}) }, async () => {
    const { page, faults } = await viewer({ colorScheme, height: 740 });
    await page.keyboard.press("f");
    const found = await page.evaluate(() => {
      const brightness = (colour: string): number => (colour.match(/[\d.]+/g) ?? []).slice(0, 3).reduce((sum, value) => sum + Number(value), 0) / 3;
      const panel = getComputedStyle(document.querySelector("aside")!), controls = [...document.querySelectorAll<HTMLInputElement>("input, select, button")].filter((one) => one.offsetParent);
      return {
        wide: document.documentElement.scrollWidth - innerWidth, tall: document.documentElement.scrollHeight - innerHeight, ground: brightness(panel.backgroundColor), text: brightness(panel.color),
        nameless: controls.filter((one) => !one.ariaLabel && !one.labels?.[0]?.textContent?.trim() && !one.textContent?.trim()).map((one) => one.id),
      };
    });
    assert.ok(found.wide <= 0 && found.tall <= 0, `${found.wide} px wider, ${found.tall} px taller than the window`);
    assert.ok(colorScheme === "light" ? found.ground > 200 && found.text < 80 : found.ground < 60 && found.text > 180, JSON.stringify(found));
    assert.deepEqual(found.nameless, []);
    assert.deepEqual(faults, []);
    await page.close();
  });
