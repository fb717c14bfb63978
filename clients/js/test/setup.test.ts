// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe setup` in Chromium, with the real command, a real daemon and a simulated camera. */
import assert from "node:assert/strict";
import { once } from "node:events";
import { spawn, type ChildProcess } from "node:child_process";
import { existsSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { LONG_MS, launch } from "./chromium.js";
import { WEB, panorama } from "./daemon.js";
import { ROOT } from "./golden.js";

const LIGHTPROBE = resolve(ROOT, "build/venv/bin/lightprobe");
const folder = mkdtempSync(join(tmpdir(), "lp-setup-")), config = join(folder, "lightprobed.conf");
const PICTURES = process.env["PICTURES"];
let browser: Browser, setup: ChildProcess, simulator: ChildProcess, address = "";

before(async () => {
  const camera = join(folder, "camera");
  writeFileSync(join(folder, "room.pfm"), panorama());
  simulator = spawn(LIGHTPROBE, ["simulate", "--socket", camera, "--size", "256x128", "--scenes", "procedural:1", "--act-s", "0", "--rate", "8"], { stdio: "ignore" });
  for (let left = 600; !existsSync(camera); left--) {
    assert.ok(left, "the simulator does not listen");
    await new Promise((done) => setTimeout(done, 100));
  }
  writeFileSync(config, `# mine\nname = hall\nsource = sim:${camera}\npublish = unix:${folder}/probe\n`);
  setup = spawn(LIGHTPROBE, ["setup", "--config", config, "--port", "0", "--dir", join(folder, "pair"), "--page", WEB], { stdio: ["ignore", "pipe", "inherit"] });
  const [line] = (await once(createInterface(setup.stdout!), "line")) as [string];
  address = line;
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  for (const one of [setup, simulator]) {
    one?.kill("SIGTERM");
    if (one && one.exitCode === null && one.signalCode === null) await once(one, "exit");
  }
  rmSync(folder, { recursive: true });
});

/** The page as it is when the probe has answered; it fails on errors of the page. */
async function opened(at: string, width = 820, height = 1100): Promise<Page> {
  const page = await browser.newPage({ viewport: { width, height } });
  page.on("pageerror", (error) => { throw error; });
  page.on("response", (answer) => { if (answer.status() >= 400 && !answer.url().includes("/api/")) throw new Error(`${answer.url()}: ${answer.status()}`); });
  await page.goto(at, { timeout: LONG_MS });
  return page;
}

const shows = (page: Page, id: string, text: RegExp): Promise<unknown> =>
  page.waitForFunction(([id, source]) => new RegExp(source!).test(document.getElementById(id!)!.textContent ?? ""), [id, text.source], { timeout: LONG_MS });

/** Presses a button of a task. */
async function begin(page: Page, task: string): Promise<void> {
  await page.locator(`[data-task="${task}"] summary`).click();
  await page.locator(`[data-task="${task}"] button`).click();
}

test("without the owner's token the page says what to do, and shows nothing", { timeout: LONG_MS }, async () => {
  const page = await opened(address.split("#")[0]!);
  await shows(page, "problem", /open the address that `lightprobe setup` prints/);
  assert.equal(await page.locator("[data-task]").count(), 0);
  await page.close();
  const other = await opened(address.replace(/owner=.*/, "owner=guessed"));
  await shows(other, "problem", /not the owner's token/);
  assert.equal(await other.locator("#log").textContent(), "");
  await other.close();
});

test("a name is changed; a camera that is none is refused by the daemon's words", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened(address);
  await shows(page, "status", /^runs, version /);
  await page.locator("[name=name]").fill("living room");
  await page.locator("#settings button").first().click();
  await shows(page, "name", /^living room$/);
  await shows(page, "status", /^runs/);
  assert.equal(readFileSync(config, "utf-8").split("\n")[1], "name = living room");
  await page.locator("[name=camera]").fill("/nowhere/my.camera");
  await page.locator("#settings button").first().click();
  await shows(page, "problem", /nowhere\/my\.camera/);
  await shows(page, "status", /^runs/);
  assert.equal(await page.locator("[name=camera]").inputValue(), "/nowhere/my.camera"); // to be mended
  assert.doesNotMatch(readFileSync(config, "utf-8"), /nowhere/);
  await page.close();
});

test("a look, and a calibration whose file is then used", { timeout: 4 * LONG_MS }, async () => {
  const page = await opened(address);
  await shows(page, "status", /^runs/);
  await begin(page, "doctor");
  await shows(page, "running-state", /^(done|ended with status 1)/);
  assert.match((await page.locator("#output").textContent())!, /ok {3}connection lightprobed /);
  await begin(page, "exposure");
  await shows(page, "running-state", /^runs/);
  assert.ok(await page.locator("#settings button").first().isDisabled());
  const again = await opened(address); // a second window shows the same task
  await shows(again, "running-title", /delay/);
  await again.close();
  await shows(page, "running-state", /^(done|ended)/);
  assert.match((await page.locator("#running-state").textContent())!, /^done/, (await page.locator("#output").textContent())!);
  assert.equal(await page.locator("#stop").isVisible(), false);
  await page.locator("#use").click();
  await shows(page, "status", /^runs/);
  await page.waitForFunction(() => document.querySelector<HTMLInputElement>("[name=camera]")!.value.endsWith("/my.camera"), null, { timeout: LONG_MS });
  assert.match(readFileSync(config, "utf-8"), /\ncamera = .*\/my\.camera\n/);
  assert.match(readFileSync(join(folder, "my.camera"), "utf-8"), /delay/);
  if (PICTURES) await page.screenshot({ path: join(PICTURES, "setup_desktop.png"), fullPage: true });
  await page.close();
});

test("an update is sent whole; where the probe is no card it is refused by its words", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened("about:blank");
  await page.route("**/api/state", async (route) => { // a card, as far as the page knows
    const answer = await route.fetch();
    const state = (await answer.json()) as { tasks: unknown[]; card: string };
    const field = { name: "file", label: "Update", kind: "upload", initial: "", choices: [] };
    state.tasks.push({ name: "update", title: "Update", words: "", fields: [field], takes_devices: false, asks: false, minutes: 3, setting: "", next_step: "" });
    state.card = "202611300000-abc";
    await route.fulfill({ json: state });
  });
  await page.goto(address);
  await shows(page, "status", /^runs, version \S+, card 202611300000-abc$/);
  const update = Buffer.alloc(5_000_000, 7);
  await page.locator('[data-task="update"] summary').click();
  await page.locator('[data-task="update"] input').setInputFiles({ name: "new.raucb", mimeType: "", buffer: update });
  await page.locator('[data-task="update"] button').click();
  await shows(page, "problem", /'update': no such task/);
  assert.ok(readFileSync(join(folder, "upload")).equals(update));
  assert.ok(await page.locator('[data-task="update"] button').isEnabled());
  await page.close();
});

test("a restart while a task runs is told", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened(address);
  await shows(page, "status", /^runs/);
  let restarted = false;
  await page.route("**/api/job?after=*", (route) => restarted ? route.fulfill({ status: 404, json: { problem: "setup: no task has been begun" } }) : route.abort());
  await begin(page, "doctor");
  await shows(page, "problem", /does not answer/);
  restarted = true;
  await shows(page, "running-state", /the probe has restarted/);
  await shows(page, "status", /^runs/);
  assert.equal(await page.locator("#problem").isVisible(), false);
  await page.close();
});

test("on a phone nothing is wider than the window", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened(address, 390, 844);
  await shows(page, "status", /^runs/);
  await page.locator("details").first().click();
  assert.ok(await page.evaluate(() => document.documentElement.scrollWidth <= innerWidth));
  if (PICTURES) await page.screenshot({ path: join(PICTURES, "setup_phone.png"), fullPage: true });
  await page.close();
});
