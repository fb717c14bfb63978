// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe study` in Chromium, from file:, with the real command: a session clicked through, its file analysed. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { mkdirSync, mkdtempSync, readFileSync, readdirSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { pathToFileURL } from "node:url";
import type { Browser, Page } from "playwright-core";
import { turns, type Trial } from "../web/study_order.js";
import { LONG_MS, launch } from "./chromium.js";
import { WEB } from "./daemon.js";
import { ROOT } from "./golden.js";

const LIGHTPROBE = resolve(ROOT, "build/venv/bin/lightprobe");
const PICTURES = process.env["PICTURES"];
const TITLE = `Balls </script><img src=x onerror="alert(1)"> & "more"`;
const folder = mkdtempSync(join(tmpdir(), "lp-study-"));
let browser: Browser;

interface Row { trial: string; value: number; swapped: boolean; ms: number }
interface Answers { participant: string; seed: number; study: string; simulated: boolean; screen: { shown_px: number; layout: string }; answers: Row[] }
interface Study { trials: (Trial & { role: string; right: string | number | null })[]; pictures: { id: string; method: string }[] }

/** A picture of one colour, 64 × 48: PPM, which the command does not offer but reads. */
const painted = (red: number, green: number): Buffer =>
  Buffer.concat([Buffer.from("P6 64 48 255\n"), Buffer.from(Array.from({ length: 64 * 48 }, (_, k) => [red, k < 1536 ? green : 40, 90]).flat())]);

before(async () => {
  let toml = `title = '${TITLE}'\nreference = "real"\nrepeats = 1\ncatches = 2\nidentical = 1\nexclude = { fastest_s = 0 }\n`;
  for (const [k, thing] of ["<b>chalk</b>", "glass"].entries()) {
    for (const [m, method] of ["real", "one lamp"].entries()) {
      writeFileSync(join(folder, `${k}${m}.ppm`), painted(60 + 90 * k, 80 + 120 * m));
      toml += `[[pictures]]\nfile = "${k}${m}.ppm"\nscene = "hall"\nobject = "${thing}"\nmethod = "${method}"\n`;
    }
  }
  writeFileSync(join(folder, "study.toml"), toml);
  lightprobe("make", join(folder, "study.toml"), join(folder, "out"), "--page", WEB);
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  rmSync(folder, { recursive: true });
});

function lightprobe(...words: string[]): string {
  return execFileSync(LIGHTPROBE, ["study", ...words], { encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
}
const page_at = (hash = ""): string => pathToFileURL(join(folder, "out/page/index.html")).href + hash;
const study = (): Study => JSON.parse(readFileSync(join(folder, "out/study.json"), "utf8")) as Study;

async function opened(width: number, height: number, hash = ""): Promise<Page> {
  const context = await browser.newContext({ viewport: { width, height }, acceptDownloads: true });
  const page = await context.newPage();
  page.on("pageerror", (error) => { throw error; });
  page.on("request", (asked) => { if (!/^(file|data|blob):/.test(asked.url())) throw new Error(`the page asks the network: ${asked.url()}`); });
  page.on("dialog", (dialog) => { void dialog.accept(); });
  await page.goto(page_at(hash), { timeout: LONG_MS });
  return page;
}

const visible = (page: Page): Promise<unknown> => page.waitForFunction(() => document.getElementById("pictures")!.style.visibility === "visible", undefined, { timeout: LONG_MS });
const count = (page: Page): Promise<string | null> => page.locator("#count").textContent();

/** Answer one trial; by keys or by touch. Gives whether it was the last. */
async function answered(page: Page, by: "keys" | "touch", rating: string): Promise<boolean> {
  await visible(page);
  const said = (await count(page))!, rates = await page.locator("#scale").isVisible();
  const asked = rates && await page.locator("#asked").isVisible() ? /give it a (\d+)/.exec((await page.locator("#asked").textContent())!)![1]! : undefined;
  assert.ok(await page.locator("#next").isDisabled(), "Next waits for an answer");
  assert.equal(await page.evaluate(() => document.activeElement?.tagName), "BODY", "nothing tells the answer before");
  if (by === "keys") {
    for (const digit of rates ? (asked ?? rating) : ["ArrowLeft"]) await page.keyboard.press(digit);
    await page.keyboard.press("Enter");
  } else {
    await (rates ? page.locator("#scale label").nth(Number(asked ?? rating)) : page.locator("#pictures label").last()).click();
    await page.locator("#next").click();
  }
  const [, done, all] = /(\d+) of (\d+)/.exec(said)!;
  if (done === all) return true;
  await page.waitForFunction((before) => document.getElementById("count")!.textContent !== before, said, { timeout: LONG_MS });
  return false;
}

async function session(page: Page, by: "keys" | "touch", rating: string): Promise<Answers> {
  const download = page.waitForEvent("download", { timeout: LONG_MS });
  while (!(await answered(page, by, rating)));
  await page.locator("#end").waitFor();
  const file = join(folder, "answers", (await download).suggestedFilename());
  mkdirSync(join(folder, "answers"), { recursive: true });
  await (await download).saveAs(file);
  return JSON.parse(readFileSync(file, "utf8")) as Answers;
}

async function photographed(page: Page, name: string): Promise<void> {
  if (PICTURES) await page.screenshot({ path: join(PICTURES, `study_${name}.png`) });
}

test("a whole session by keys survives a reload; its file is in the seed's order, and is analysed", { timeout: 3 * LONG_MS }, async () => {
  const page = await opened(1280, 800, "#seed=7&participant=P01");
  assert.equal(await page.locator("#title").textContent(), TITLE);
  assert.equal(await page.title(), TITLE);
  await photographed(page, "welcome");
  await page.locator("#begin").click();
  await answered(page, "keys", "10");
  await answered(page, "keys", "10");
  await visible(page);
  await photographed(page, "rating");
  const before = await count(page);
  await page.reload();
  await visible(page);
  assert.equal(await count(page), before, "a reload loses nothing");
  const found = await session(page, "keys", "10");
  assert.equal(found.participant, "P01");
  assert.equal(found.simulated, false);
  const { trials } = study();
  const order = turns(trials, 7);
  assert.deepEqual(found.answers.map((one) => [one.trial, one.swapped]), order.map(({ trial, swapped }) => [trial.id, swapped]));
  for (const [k, { trial }] of order.entries()) {
    const { role, right } = trials.find((one) => one.id === trial.id)!;
    if (trial.kind === "rating") assert.equal(found.answers[k]!.value, role === "catch" ? right : 10);
    // ← is the first picture, or, swapped, the second.
    else assert.equal(found.answers[k]!.value, order[k]!.swapped ? 1 : 0);
    assert.ok(found.answers[k]!.ms >= 0);
  }
  await page.locator("#another").click();
  await page.locator("#welcome").waitFor();
  assert.equal(await page.evaluate(() => location.hash), "", "the next person gets the name and the seed of this one");
  await page.context().close();
});

test("on a phone all of a trial is on the screen, and is answered by touch", { timeout: 3 * LONG_MS }, async () => {
  const page = await opened(360, 640, "#participant=P02");
  await photographed(page, "phone_welcome");
  await page.locator("#begin").click();
  const fits = async (): Promise<void> => {
    const [width, height] = await page.evaluate(() => [document.documentElement.scrollWidth, document.documentElement.scrollHeight] as const);
    assert.ok(width <= 360 && height <= 640, `${width} × ${height}`);
  };
  let seenRating = false, seenChoice = false;
  while (!seenRating || !seenChoice) {
    await visible(page);
    await fits();
    const rates = await page.locator("#scale").isVisible();
    if (rates && !seenRating) await photographed(page, "phone_rating");
    if (!rates && !seenChoice) await photographed(page, "phone_choice");
    [seenRating, seenChoice] = [seenRating || rates, seenChoice || !rates];
    await answered(page, "touch", "4");
  }
  const found = await session(page, "touch", "4");
  assert.equal(found.screen.layout, "stacked");
  await photographed(page, "phone_end");
  await page.context().close();
});

test("the files of two people are analysed; who did not look is named", { timeout: LONG_MS }, () => {
  const files = readdirSync(join(folder, "answers")).map((name) => join(folder, "answers", name));
  assert.equal(files.length, 2);
  // Both chose by place: of catch trials of choices half are missed.
  assert.throws(() => lightprobe("analyse", join(folder, "out"), join(folder, "nobody")), /nobody/);
  const truth = study();
  for (const file of files) {
    const answers = JSON.parse(readFileSync(file, "utf8")) as Answers;
    for (const one of answers.answers) {
      const { role, right, pictures } = truth.trials.find((trial) => trial.id === one.trial)!;
      if (role === "catch" && typeof right === "string") one.value = pictures.indexOf(right);
    }
    writeFileSync(file, JSON.stringify(answers));
  }
  const text = lightprobe("analyse", join(folder, "out"), join(folder, "answers"));
  assert.match(text, /^2 participants, 0 left out/m);
  assert.match(text, /\| real \(real\) \| 7\.00/);
  assert.doesNotMatch(text, /SIMULATED/i);
});

test("who stops leaves nothing behind; the page tells no method", { timeout: 2 * LONG_MS }, async () => {
  const page = await opened(800, 600);
  await page.locator("#begin").click();
  await answered(page, "keys", "5");
  await page.locator("#stop").click();
  await page.locator("#stopped").waitFor();
  assert.equal(await page.evaluate(() => localStorage.length), 0);
  for (const id of ["data", "trial"]) assert.doesNotMatch((await page.locator(`#${id}`).textContent())!, /one lamp|chalk|catch|repeat|identical/);
  await page.context().close();
});

test("a picture that is gone is named", { timeout: LONG_MS }, async () => {
  const pictures = join(folder, "out/page/pictures"), [first] = readdirSync(pictures);
  rmSync(join(pictures, first!));
  const page = await opened(800, 600);
  await page.locator("#problem").waitFor();
  assert.match((await page.locator("#problem").textContent())!, new RegExp(`pictures/${first!} cannot be loaded`));
  assert.ok(await page.locator("#begin").isDisabled());
  await page.context().close();
});

test("of the pairs that are compared half are swapped, whatever else is asked", () => {
  const rated = Array.from({ length: 14 }, (_, k): Trial => ({ id: `r${k}`, kind: "rating", pictures: [`p${k}`] }));
  const pair = (id: string, ...pictures: string[]): Trial => ({ id, kind: "choice", pictures });
  const once = Array.from({ length: 5 }, (_, k) => pair(`o${k}`, `p${2 * k}`, `p${2 * k + 1}`));
  const twice = [10, 12].flatMap((k) => ["t", "u"].map((name) => pair(name + k, `p${k}`, `p${k + 1}`)));
  const others = [...[1, 3, 5, 7].map((k) => pair(`c${k}`, `p${k}`, `turned${k}`)), pair("i1", "p1", "p1"), pair("i2", "p1", "p1")];
  const more = new Map<number, number>();
  for (let seed = 0; seed < 200; seed++) {
    const order = turns([...rated, ...others, ...twice, ...once], seed);
    const swapped = (of: Trial[]): number => order.filter(({ trial, swapped: is }) => is && of.includes(trial)).length;
    const count = swapped(once);
    more.set(count, (more.get(count) ?? 0) + 1);
    assert.equal(swapped(twice), 2);
    assert.equal(swapped(others), 3);
  }
  // 2 or 3 of 5, about as often: 100 times of 200 with a deviation of 7.
  assert.deepEqual([...more.keys()].sort(), [2, 3]);
  assert.ok(Math.abs(more.get(2)! - 100) < 35, `2 of 5: ${more.get(2)!} times of 200`);
});

test("an order has all trials, half of the choices swapped, a pair that comes again the other way round", () => {
  const trials: Trial[] = [
    ...Array.from({ length: 12 }, (_, k): Trial => ({ id: `r${k}`, kind: "rating", pictures: [`p${k % 10}`] })),
    ...Array.from({ length: 17 }, (_, k): Trial => ({ id: `c${k}`, kind: "choice", pictures: [`p${k % 12}`, `q${k % 12}`] })),
  ];
  const firsts = new Map<string, number>();
  for (let seed = 0; seed < 400; seed++) {
    const order = turns(trials, seed);
    assert.deepEqual(order, turns(trials, seed));
    assert.deepEqual(order.map((one) => one.trial.id).sort(), trials.map((one) => one.id).sort());
    assert.ok(order.slice(0, 12).every((one) => one.trial.kind === "rating"));
    assert.ok([8, 9].includes(order.filter((one) => one.swapped).length));
    for (let k = 0; k < 5; k++) {
      const [one, other] = [`c${k}`, `c${k + 12}`].map((id) => order.find(({ trial }) => trial.id === id)!.swapped);
      assert.notEqual(one, other);
    }
    // But for the last rating and the first choice.
    order.forEach(({ trial }, k) => assert.ok(k === 0 || k === 12 || !order[k - 1]!.trial.pictures.some((picture) => trial.pictures.includes(picture))));
    firsts.set(order[0]!.trial.id, (firsts.get(order[0]!.trial.id) ?? 0) + 1);
  }
  // Each of 12 comes first 33 times of 400 in the mean, with a deviation of 5.5.
  for (const trial of trials.slice(0, 12)) assert.ok(Math.abs((firsts.get(trial.id) ?? 0) - 400 / 12) < 25, trial.id);
});
