// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe setup` in Chromium, with the real command, a real daemon and a simulated camera. */
import assert from "node:assert/strict";
import { once } from "node:events";
import { spawn, type ChildProcess } from "node:child_process";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import { after, before, test } from "node:test";
import type { Browser, Locator, Page } from "playwright-core";
import { LONG_MS, launch } from "./chromium.js";
import { WEB, panorama } from "./daemon.js";
import { ROOT } from "./golden.js";

const LIGHTPROBE = resolve(ROOT, "build/venv/bin/lightprobe");
const folder = mkdtempSync(join(tmpdir(), "lp-setup-")), config = join(folder, "lightprobed.conf");
/** What a program that stands for nmcli is told (tests/fakes/nmcli), and what is in the air. */
const air = join(folder, "nmcli.json"), networks = join(folder, "networks");
const PASSWORD = "right: \\password", HOSTILE = "<img src=x onerror=alert(1)>\u202e\n";
const hex = (text: string): string => Buffer.from(text).toString("hex");
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
  mkdirSync(networks);
  const wpa2 = { signal: 60, security: "WPA2", rsn: "psk", password: PASSWORD };
  const point = { uuid: "11", id: "lightprobe", ssid: hex("lightprobe-1"), psk: "x", mode: "ap" };
  writeFileSync(air, JSON.stringify({
    radio: "connected", saved: { 11: point }, active: "11",
    air: [{ ...wpa2, ssid: hex("Café ☕") }, { ...wpa2, ssid: hex(HOSTILE), signal: 30 }, { ...wpa2, ssid: hex("work"), security: "WPA2 802.1X", rsn: "802.1X" }],
  }));
  setup = spawn(LIGHTPROBE, ["setup", "--config", config, "--port", "0", "--dir", join(folder, "pair"), "--page", WEB, "--networks", networks], {
    stdio: ["ignore", "pipe", "inherit"], env: { ...process.env, PATH: `${join(ROOT, "tests/fakes")}:${process.env["PATH"]}`, FAKE_NMCLI: air },
  });
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

test("where the probe is no card an update is refused by its words", { timeout: 2 * LONG_MS }, async () => {
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
  await shows(page, "problem", /no task of this machine takes a file/);
  await shows(page, "status", /^runs, version/);
  assert.ok(await page.locator('[data-task="update"] button').isEnabled());
  await page.close();
});

test("after an update the page shows the version of the next start", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened("about:blank");
  let starts = 0, sent = 0;
  await page.route("**/api/**", async (route) => {
    const path = new URL(route.request().url()).pathname.replace("/api/", ""), method = route.request().method();
    if (path === "state") {
      const answer = await route.fetch();
      const state = (await answer.json()) as { tasks: unknown[]; card: string; boot: string };
      const field = { name: "file", label: "Update", kind: "upload", initial: "", choices: [] };
      state.tasks.push({ name: "update", title: "Update", words: "", fields: [field], takes_devices: false, asks: false, ends_by_itself: true, restarts: true, minutes: 3, setting: "", next_step: "" });
      if (sent && ++starts === 3) return route.abort(); // it restarts
      state.card = state.boot = starts < 4 ? "old" : "new";
      return route.fulfill({ json: state });
    }
    if (path === "upload") sent = route.request().postDataBuffer()!.length;
    if (path === "job" && method === "GET" && !sent) return route.fulfill({ status: 404, json: { problem: "none" } });
    if (path === "job" && method === "GET") return route.fulfill({ json: { task: "update", status: 0, waits: false, said: 1, lines: ["100 %  done"], seconds: 9, files: [], written: null } });
    if (path === "upload" || path === "job") return route.fulfill({ json: {} });
    return route.continue();
  });
  await page.goto(address);
  await shows(page, "status", /card old$/);
  await page.locator('[data-task="update"] summary').click();
  await page.locator('[data-task="update"] input').setInputFiles({ name: "new.raucb", mimeType: "", buffer: Buffer.alloc(1000) });
  await page.locator('[data-task="update"] button').click();
  await shows(page, "running-state", /^done: the probe restarts$/);
  assert.equal(await page.locator("#stop").isVisible(), false);
  await shows(page, "running-state", /the probe has restarted/);
  await shows(page, "status", /card new$/);
  assert.equal(sent, 1000);
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

/** The row of a network. */
const row = (page: Page, name: string): Locator => page.locator("#networks li", { hasText: name });

test("a network is joined, or the probe's own Wi-Fi is back, and the page says so before and after", { timeout: 4 * LONG_MS }, async () => {
  const page = await opened(address);
  await shows(page, "links", /^Connected by its own Wi-Fi lightprobe-1 \(wlan0\)\.$/);
  await shows(page, "network-note", /cut off.*back within two minutes.*http:\/\/127\.0\.0\.1:\d+\/setup\.html$/);
  assert.match((await page.locator("#network-note a").getAttribute("href"))!, /\/setup\.html#owner=.{32}$/);
  assert.equal(await page.locator("#networks img").count(), 0); // names are text
  assert.equal(await page.locator("#networks li").nth(2).locator("b").textContent(), "<img src=x onerror=alert(1)>\\xe2\\x80\\xae\\x0a");
  if (PICTURES) await page.screenshot({ path: join(PICTURES, "setup_network.png"), fullPage: true });
  const tryIt = async (password: string): Promise<void> => {
    await row(page, "Café").getByText("Join").click();
    assert.equal(await page.locator("[name=network]").inputValue(), "Café ☕");
    await page.locator("[name=password]").fill(password);
    await page.locator("#join button").first().click();
  };
  await tryIt("wrong password");
  await shows(page, "network-state", /^Joining Café ☕/);
  assert.equal(await page.locator("[name=password]").inputValue(), "");
  assert.ok(await page.locator("#join button").first().isDisabled());
  await shows(page, "network-state", /the password is wrong.*its own Wi-Fi lightprobe-1 is back$/);
  assert.deepEqual(readdirSync(networks), []);
  await row(page, "work").getByText("Join").click();
  await page.locator("[name=password]").fill("12345678");
  await page.locator("#join button").first().click();
  await shows(page, "network-state", /enterprise/);
  await tryIt(PASSWORD);
  await shows(page, "network-state", /^Café ☕ is joined\.$/);
  await shows(page, "links", /^Connected by wifi Café ☕ \(wlan0\)\.$/);
  assert.match((await row(page, "Café").textContent())!, /60 %, WPA2, joined/);
  assert.doesNotMatch(readFileSync(`${air}.calls`, "utf-8"), /password/);
  page.once("dialog", (dialog) => void dialog.dismiss());
  await row(page, "Café").getByText("Forget").click();
  assert.match((await row(page, "Café").textContent())!, /joined/); // asked, and not wanted
  page.once("dialog", (dialog) => void dialog.accept());
  await row(page, "Café").getByText("Forget").click();
  await shows(page, "network-state", /^Café ☕ is forgotten\.$/);
  await shows(page, "links", /^Connected by nothing\.$/);
  assert.deepEqual(readdirSync(networks), []);
  await page.locator("[name=network]").fill("not here"); // one that is hidden, or away
  await page.locator("[name=password]").fill(PASSWORD);
  await page.locator("#join button").first().click();
  await shows(page, "network-state", /not here: join: it is not in reach$/);
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
