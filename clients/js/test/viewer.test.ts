// SPDX-License-Identifier: Apache-2.0
/** The viewer in headless Chromium, with a live daemon. */
import assert from "node:assert/strict";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { resolve } from "node:path";
import { test } from "node:test";
import { fromBinary, toBinary } from "@bufbuild/protobuf";
import type { Page } from "playwright-core";
import { decode } from "../src/index.js";
import * as pb from "../src/gen/lightprobe_pb.js";
import { LONG_MS, NIGHTLY, launch } from "./chromium.js";
import { LiveDaemon, WEB } from "./daemon.js";
import { redCube } from "./gltf.js";
import { live } from "./live.js";

const session = live(), { daemon } = session;

/** The viewer in a window of this size; it fails on errors of the page and on requests to elsewhere. `listen` gets the
 *  page before it connects. */
async function viewer(width: number, height: number, listen: (page: Page) => void = () => {}, route: (page: Page) => Promise<void> = async () => {}): Promise<{ page: Page; faults: string[] }> {
  const page = await session.browser.newPage({ viewport: { width, height }, reducedMotion: "reduce" });
  const faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  page.on("console", (message) => { if (message.type() === "error") faults.push(message.text()); });
  page.on("request", (request) => { if (!/^(data|blob):/.test(request.url()) && new URL(request.url()).host !== `127.0.0.1:${daemon.port}`) faults.push(`request to ${request.url()}`); });
  listen(page);
  await route(page);
  await page.goto(`http://127.0.0.1:${daemon.port}/`, { timeout: LONG_MS });
  return { page, faults };
}

const BAD_FILE = { name: "bad.glb", mimeType: "model/gltf-binary", buffer: Buffer.from("no glTF") };
const CUBE = { name: "cube.glb", mimeType: "model/gltf-binary", buffer: redCube() };

/** Waits until the page says that something is in the way of what the user has done. */
async function problem(page: Page, text: RegExp): Promise<void> {
  await page.waitForFunction((source) => new RegExp(source).test(document.getElementById("problem")!.textContent ?? ""), text.source, { timeout: LONG_MS });
  assert.ok(await page.locator("#problem").isVisible());
}

/** Waits until the figures beside the picture have been shown anew so often. */
const figures = (page: Page, times: number): Promise<void> => page.evaluate((count) => new Promise<void>((done) => {
  let left = count;
  new MutationObserver(() => { if (--left === 0) done(); }).observe(document.getElementById("figures")!, { childList: true });
}), times);

const lit = (page: Page): Promise<unknown> => page.waitForFunction(() => Number(document.body.dataset["frames"]) > 3 && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });

for (const [name, width, height] of [["desktop", 1000, 640], ["phone", 390, 844]] as const)
  test(`the viewer shows the live light: ${name}`, { timeout: 3 * LONG_MS, ...(name === "desktop" ? NIGHTLY : {}) }, async () => {
    const { page, faults } = await viewer(width, height);
    await lit(page);
    assert.equal(await page.locator("#status").textContent(), "test room");
    const [azimuth, elevation] = (await page.locator("#lamps tbody tr:first-child td").allTextContents()).slice(1, 3);
    assert.match(azimuth!, /^[0-3]°$/);
    assert.match(elevation!, /^4[2-6]° ± /);
    assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth), "the page is wider than its window");
    const wide = await page.evaluate(() => {
      const panel = document.querySelector("aside")!, right = panel.getBoundingClientRect().left + panel.clientWidth; // without the scroll bar
      return [...panel.querySelectorAll("*")].filter((one) => !one.closest(".hidden") && one.getBoundingClientRect().right > right).map((one) => one.outerHTML.slice(0, 80));
    });
    assert.deepEqual(wide, [], "beyond the panel's edge");
    for (const id of ["problem", "connection"]) assert.equal(await page.locator(`#${id}`).isVisible(), false);
    assert.deepEqual(faults, []);
    await page.close();
  });

test("opened without TLS, but with a token, the page says that tokens go over https alone", { timeout: LONG_MS }, async () => {
  const page = await session.browser.newPage(), sockets: string[] = [];
  page.on("websocket", (socket) => sockets.push(socket.url()));
  await page.goto(`http://127.0.0.1:${daemon.port}/#token=secret`, { timeout: LONG_MS });
  await problem(page, /http: would send the token in clear: take the address that `lightprobe pair` prints, with https: or wss:/);
  assert.ok(!(await page.locator("#problem").textContent())!.includes("secret"));
  assert.deepEqual(sockets, []);
  await page.close();
});

test("keys switch what is shown", { timeout: 2 * LONG_MS }, async () => {
  const { page, faults } = await viewer(500, 400);
  await lit(page);
  for (const [key, id] of [["l", "use-lamps"], ["a", "use-ambient"], ["r", "turn"], ["f", "use-formulas"], ["k", "use-key"], ["m", "use-map"]] as const) {
    const former = await page.locator(`#${id}`).isChecked();
    await page.keyboard.press(key);
    assert.equal(await page.locator(`#${id}`).isChecked(), !former);
  }
  await page.selectOption("#lights", "0");
  await page.waitForFunction(() => document.querySelector("#lamps tbody")!.textContent!.trim().startsWith("KEY"), null, { timeout: LONG_MS });
  assert.deepEqual(faults, []);
  await page.close();
});

/** The picture in 64 × 64 pixels of red, green, blue and alpha, once `frames` more have been drawn. */
async function picture(page: Page, frames: number): Promise<number[]> {
  const drawn = await page.evaluate(() => Number(document.body.dataset["frames"]));
  await page.waitForFunction((wanted) => Number(document.body.dataset["frames"]) > wanted, drawn + frames, { timeout: LONG_MS });
  return page.evaluate(() => {
    const small = new OffscreenCanvas(64, 64).getContext("2d")!;
    small.drawImage(document.querySelector<HTMLCanvasElement>("#view")!, 0, 0, 64, 64);
    return [...small.getImageData(0, 0, 64, 64).data];
  });
}

/** Channels that are clearly not the same. */
const different = (one: number[], other: number[]): number => one.filter((value, i) => Math.abs(value - other[i]!) > 20).length;

/** The picture, once exposure, shadows and resolution no longer change it. */
async function settled(page: Page): Promise<number[]> {
  let before = await picture(page, 3), still = await picture(page, 3);
  for (let i = 0; i < 20 && different(before, still) > 4; i++) [before, still] = [still, await picture(page, 3)];
  assert.ok(different(before, still) <= 4, `${different(before, still)} values change by themselves`);
  return still;
}

test("classic formulas change the picture", { timeout: 3 * LONG_MS, ...NIGHTLY }, async () => {
  const { page, faults } = await viewer(500, 400);
  await lit(page);
  const before = await settled(page);
  await page.keyboard.press("f");
  const changed = different(before, await picture(page, 3));
  assert.ok(changed > 40, `only ${changed} values change with the materials`);
  assert.deepEqual(faults, []);
  await page.close();
});

test("what is asked of the probe, it is asked, and shows", { timeout: 4 * LONG_MS }, async () => {
  const asked: pb.Subscription[] = [];
  let maps = 0;
  const { page, faults } = await viewer(500, 400, (unconnected) => unconnected.on("websocket", (socket) => {
    socket.on("framesent", ({ payload }) => {
      const { message } = fromBinary(pb.FromClientSchema, payload as Buffer);
      if (message.case === "subscribe") asked.push(message.value);
    });
    socket.on("framereceived", ({ payload }) => { if (decode(payload as Buffer)?.kind === "reflectionMap") maps++; });
  }));
  await lit(page);
  for (const order of [4, 3, 0]) {
    await page.selectOption("#order", String(order));
    await page.waitForFunction((rows) => document.getElementById("sh")!.textContent!.trim().split("\n").length === rows, (order + 1) ** 2, { timeout: LONG_MS });
  }
  await page.selectOption("#order", "2");
  await page.selectOption("#lights", "0");
  await page.waitForFunction(() => !document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  await page.locator("#use-key").check();
  await page.waitForFunction(() => document.querySelector("#lamps tbody tr:first-child td")?.textContent?.includes("KEY"), null, { timeout: LONG_MS });
  assert.match((await page.locator("#lamps tbody tr:first-child td").allTextContents())[1]!, /^-?\d°$/);
  assert.ok(asked.at(-1)!.keyLight && asked.at(-1)!.reflectionMap);
  await page.locator("#use-key").uncheck();
  // Of a lamp that is not listed the map has a picture, and the SH have not.
  while (maps === 0) await page.waitForTimeout(100);
  const mirrored = await settled(page);
  await page.locator("#use-map").uncheck();
  const changed = different(mirrored, await settled(page));
  assert.ok(changed > 20, `only ${changed} values change without the map`);
  assert.equal(asked.at(-1)!.reflectionMap, undefined);
  const had = maps;
  await figures(page, 10);
  assert.ok(maps - had <= 2, "maps still come"); // one may have been on its way
  assert.deepEqual(faults, []);
  await page.close();
});

test("a probe without reflection maps is not asked for one", { timeout: 2 * LONG_MS, ...NIGHTLY }, async () => {
  const other = await new LiveDaemon().start(undefined, "--reflection-map=off");
  const page = await session.browser.newPage({ viewport: { width: 500, height: 400 } });
  await page.goto(`http://127.0.0.1:${other.port}/`);
  await lit(page);
  assert.ok(await page.locator("#use-map").isDisabled());
  assert.equal(await page.locator("#use-map").isChecked(), false);
  assert.equal(await page.locator("#connection").isVisible(), false);
  await page.close();
  other.kill();
});

/** The switches that are on, of those that may have nothing to show. */
const ticks = (page: Page): Promise<string[]> => page.evaluate(() => [...document.querySelectorAll<HTMLInputElement>("#use-truth, #use-ground, #use-map")].filter((box) => box.checked || !box.disabled).map((box) => `${box.id}${box.checked ? "" : " off"}`));

test("what is not there is not ticked: a truth, a marker in sight", { timeout: 3 * LONG_MS, ...NIGHTLY }, async () => {
  const { page, faults } = await viewer(500, 400);
  await lit(page);
  assert.deepEqual(await ticks(page), ["use-map"]);
  for (const [id, missing] of [["use-truth", /\?truth=/], ["use-ground", /marker/]] as const)
    assert.match(await page.locator(`label:has(#${id})`).getAttribute("title") ?? "", missing);
  await page.goto(`http://127.0.0.1:${daemon.port}/?truth=ws://127.0.0.1:${daemon.port}/`);
  await lit(page);
  assert.deepEqual(await ticks(page), ["use-truth", "use-map"]);
  await page.waitForFunction(() => !document.getElementById("right")!.hidden, null, { timeout: LONG_MS });
  await page.keyboard.press("t");
  await page.waitForFunction(() => document.getElementById("right")!.hidden, null, { timeout: LONG_MS });
  assert.deepEqual(await ticks(page), ["use-truth off", "use-map"]);
  assert.deepEqual(faults, []);
  await page.close();
});

/** Waits until the label under the picture says so. */
const labelled = (page: Page, text: RegExp): Promise<unknown> => page.waitForFunction((source) => new RegExp(source).test(document.getElementById("left")!.textContent!), text.source, { timeout: LONG_MS });

/** Pixels that are black or not drawn. */
const black = (pixels: number[]): number => pixels.filter((_, i) => i % 4 === 0 && (pixels[i + 3]! < 255 || pixels[i]! + pixels[i + 1]! + pixels[i + 2]! < 15)).length;

test("without light the page says what it waits for, and shows a fallback", { timeout: 6 * LONG_MS }, async () => {
  let passes: (kind: string) => boolean = () => false, lose = (): void => {};
  const { page, faults } = await viewer(500, 400, () => {}, (unconnected) => unconnected.routeWebSocket(/./, (socket) => {
    const probe = socket.connectToServer();
    lose = () => { void socket.close(); };
    probe.onMessage((data) => {
      const whole = fromBinary(pb.FromProbeSchema, data as Buffer), { message } = whole;
      if (message.case === "estimate") message.value.ttlMs = 3000;
      if (passes(message.case!)) socket.send(Buffer.from(toBinary(pb.FromProbeSchema, whole)));
    });
  }));
  const drawn = async (): Promise<void> => assert.ok(black(await picture(page, 3)) < 40, "the picture is dark");
  await labelled(page, /^not the room's light: waiting for the connection$/);
  await drawn();
  passes = (kind) => kind !== "estimate";
  await labelled(page, /^not the room's light: connected, waiting for the first light \(its camera: streaming\)$/);
  await drawn();
  passes = () => true;
  await labelled(page, /^lit by the probe$/);
  await lit(page);
  passes = (kind) => kind !== "estimate";
  await labelled(page, /^not the room's light: connected, waiting for newer light/);
  await drawn();
  assert.equal(await page.evaluate(() => document.body.dataset["sequence"]), "0");
  passes = () => false;
  lose();
  await labelled(page, /^not the room's light: the probe is gone: connecting again$/);
  await drawn();
  assert.deepEqual(faults, []);
  await page.close();
});

const red = (pixels: number[]): number => pixels.filter((value, i) => i % 4 === 0 && value > 60 && value > 3 * pixels[i + 1]! && value > 3 * pixels[i + 2]!).length;

test("a glTF object is shown in place of the spheres; metal in it mirrors the room", { timeout: 4 * LONG_MS }, async () => {
  const { page, faults } = await viewer(500, 400);
  await lit(page);
  await page.keyboard.press("l"); // the surroundings alone
  const before = await settled(page);
  await page.locator("#object").setInputFiles(CUBE);
  const after = await settled(page);
  assert.ok(red(after) > 200 && red(after) > 3 * red(before), `${red(before)} red pixels with spheres, ${red(after)} with the cube`);
  assert.equal(await page.locator("#problem").isVisible(), false);
  assert.deepEqual(faults, []);
  await page.close();
});

test("what was in the user's way stays until an action succeeds, or it is dismissed", { timeout: 4 * LONG_MS }, async () => {
  const { page, faults } = await viewer(500, 400);
  await lit(page);
  const stays = async (text: RegExp): Promise<void> => {
    await problem(page, text);
    await figures(page, 5);
    await problem(page, text);
  };
  await page.locator("#object").setInputFiles(BAD_FILE);
  await stays(/bad\.glb: .*: choose a \.glb file/);
  await page.locator("#object").setInputFiles(CUBE);
  await page.waitForFunction(() => document.getElementById("problem")!.hidden, null, { timeout: LONG_MS });
  await page.selectOption("#behind", "camera"); // there is none
  await stays(/camera: Not.*Error.*allow this page/);
  assert.equal(await page.locator("#behind").inputValue(), "room");
  await page.locator("#dismiss").click();
  assert.equal(await page.locator("#problem").isVisible(), false);
  assert.equal(await page.locator("#connection").isVisible(), false);
  assert.deepEqual(faults, []);
  await page.close();
});

test("a probe that restarts is found again", { timeout: 3 * LONG_MS }, async () => {
  const { page } = await viewer(500, 400);
  await lit(page);
  await page.locator("#object").setInputFiles(BAD_FILE);
  await problem(page, /bad\.glb/);
  daemon.kill();
  await page.waitForFunction(() => document.getElementById("status")!.classList.contains("bad"), null, { timeout: LONG_MS });
  await page.waitForFunction(() => /closed the connection|no answer/.test(document.getElementById("connection")!.textContent ?? ""), null, { timeout: LONG_MS });
  assert.ok(await page.locator("#connection").isVisible());
  assert.ok(await page.locator("#problem").isVisible(), "the user's problem went with the connection");
  await daemon.start();
  await page.waitForFunction(() => document.getElementById("status")!.textContent === "test room" && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  assert.equal(await page.locator("#connection").isVisible(), false);
  assert.ok(await page.locator("#problem").isVisible());
  await page.close();
});

test("without WebGL a sentence says what to do, and all but the picture works", { timeout: 2 * LONG_MS }, async () => {
  const plain = await launch("--disable-3d-apis"), page = await plain.newPage(), faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  await page.goto(`http://127.0.0.1:${daemon.port}/`);
  await problem(page, /no WebGL 2.*try another browser/);
  await page.waitForFunction(() => document.querySelector("#lamps tbody tr") && document.querySelector("#figures dd"), null, { timeout: LONG_MS });
  assert.equal(await page.locator("#status").textContent(), "test room");
  const bright = await page.evaluate(() => {
    const canvas = document.querySelector<HTMLCanvasElement>("#map")!;
    return canvas.getContext("2d")!.getImageData(0, 0, canvas.width, canvas.height).data.filter((value, i) => i % 4 < 3 && value > 40).length;
  });
  assert.ok(bright > 1000, "the map is dark");
  await page.selectOption("#lights", "0");
  await page.waitForFunction(() => !document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  assert.ok(await page.locator("#use-formulas").isDisabled(), "a switch of the picture does nothing");
  await problem(page, /no WebGL 2/);
  assert.deepEqual(faults, []);
  await plain.close();
});

test("a page of another origin gets nothing", { timeout: LONG_MS }, async () => {
  const elsewhere = createServer((_, answer) => answer.setHeader("content-type", "text/html").end("<!doctype html>"));
  await new Promise<void>((done) => { elsewhere.listen(0, "127.0.0.1", done); });
  const page = await session.browser.newPage();
  await page.goto(`http://127.0.0.1:${(elsewhere.address() as { port: number }).port}/`);
  const ask = (target: number): Promise<string> => page.evaluate((where) => new Promise<string>((done) => {
    const socket = new WebSocket(`ws://127.0.0.1:${where}/`, "lightprobe.v1");
    socket.onmessage = () => done("a message");
    socket.onerror = () => done("refused");
  }), target);
  assert.equal(await ask(daemon.port), "refused");
  await page.goto(`http://127.0.0.1:${daemon.port}/style.css`);
  assert.equal(await ask(daemon.port), "a message"); // the same question from the probe's own origin
  await page.close();
  elsewhere.close();
});

test("the page's licences are beside it", () => {
  const text = readFileSync(resolve(WEB, "main.js.LEGAL.txt"), "utf8");
  for (const name of ["three", "js-aruco2", "fzstd"]) assert.match(text, new RegExp(`^${name}$`, "m"));
  assert.ok(text.match(/Permission is hereby granted, free of charge/g)!.length >= 3);
});
