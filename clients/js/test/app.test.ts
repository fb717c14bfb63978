// SPDX-License-Identifier: Apache-2.0
/** A page of an app's own server in headless Chromium, with a live daemon: what a developer meets first. */
import assert from "node:assert/strict";
import { createServer, type Server } from "node:http";
import { after, before, test } from "node:test";
import { build } from "esbuild";
import type { Browser, Page } from "playwright-core";
import type { Probe } from "../src/index.js";
import type { lightEstimate } from "../src/webxr.js";
import { LONG_MS, launch } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";

type App = { Probe: typeof Probe; lightEstimate: typeof lightEstimate; probe: Probe };

let browser: Browser, server: Server, page: Page, origin = "";
const daemon = new LiveDaemon(), said: string[] = [];

before(async () => {
  const { outputFiles } = await build({ entryPoints: ["test/page/client.ts"], bundle: true, write: false, format: "iife" });
  server = createServer((request, answer) => request.url === "/app.js" ? answer.setHeader("content-type", "text/javascript").end(outputFiles[0]!.text)
    : answer.setHeader("content-type", "text/html").end('<!doctype html><link rel="icon" href="data:,"><script src="app.js"></script>'));
  await new Promise<void>((done) => { server.listen(0, "127.0.0.1", done); });
  origin = `http://127.0.0.1:${(server.address() as { port: number }).port}`;
  await daemon.start();
  browser = await launch();
  page = await browser.newPage();
  page.on("console", (message) => said.push(message.text()));
  await page.goto(origin, { timeout: LONG_MS });
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  daemon.kill();
  server?.close();
});

const connect = (port: number): Promise<void> => page.evaluate((where) => {
  const app = window as unknown as App;
  app.probe?.close();
  app.probe = new app.Probe(`ws://127.0.0.1:${where}/`);
}, port);

test("a page that the daemon refuses is told how to be allowed, in the error and in the console; so allowed it gets light", { timeout: 2 * LONG_MS }, async () => {
  await connect(daemon.port);
  await page.waitForFunction(() => (window as unknown as App).probe.lastError, null, { timeout: LONG_MS });
  const error = await page.evaluate(() => (window as unknown as App).probe.lastError!);
  const option = /start lightprobed with (\?origins=\S+) at the end of its --publish=ws:/.exec(error)?.[1];
  assert.equal(option, `?origins=${origin}`, error);
  assert.ok(said.some((line) => line === `lightprobe: ${error}`), said.join("\n"));
  daemon.kill();
  await daemon.start((port) => `ws:127.0.0.1:${port}${option}`);
  await page.waitForFunction(() => (window as unknown as App).probe.latest(), null, { timeout: LONG_MS });
});

test("a light estimate has points as WebXR's", { timeout: LONG_MS }, async () => {
  const found = await page.evaluate(() => {
    const app = window as unknown as App, { primaryLightDirection: direction, primaryLightIntensity: intensity } = app.lightEstimate(app.probe.latest());
    return [direction, intensity].map((point) => ({ is: point instanceof DOMPointReadOnly, w: point.w, y: point.y }));
  });
  assert.deepEqual(found.map(({ is, w }) => [is, w]), [[true, 0], [true, 1]]);
  assert.ok(Math.abs(found[0]!.y - Math.SQRT1_2) < 0.05 && found[1]!.y > 0, JSON.stringify(found));
});
