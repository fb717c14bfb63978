// SPDX-License-Identifier: Apache-2.0
/** Prints what lightprobe-webxr.js weighs, and what it takes of a frame: `make bench-webxr`. Graphics are in software. */
import { spawn } from "node:child_process";
import { existsSync, readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { gzipSync } from "node:zlib";
import { launch } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";
import { ROOT } from "./golden.js";
import { SHIM, Pages, bundled, until } from "./xr_pages.js";

const ROUNDS = Number(process.env["ROUNDS"] ?? 20);
type Times = { estimateMs: number[]; newMapMs: number[]; sameMapMs: number[] };

const pages = await new Pages(true).start(), daemon = new LiveDaemon(), browser = await launch();
/** A room that turns, so that maps are new. */
const socket = join(daemon.folder, "sim.sock");
const room = spawn(resolve(ROOT, "build/venv/bin/lightprobe"), ["simulate", "--socket", socket, "--turn-deg-s", "40", "--size", "640x320", "--rate", "10"], { stdio: "ignore" });
daemon.source = `sim:${socket}`;
try {
  while (!existsSync(socket)) await new Promise((done) => setTimeout(done, 100));
  await daemon.start((port) => `ws:127.0.0.1:${port}?origins=${pages.origin}`, "--reflection-map=64");
  console.log(`lightprobe-webxr.js: ${(gzipSync(readFileSync(SHIM), { level: 9 }).length / 1000).toFixed(1)} kB gzipped`);
  for (const size of [16, 32, 64]) {
    const { page } = await pages.open(browser, { tag: `data-probe="ws://127.0.0.1:${daemon.port}/" data-map="${size}" data-yaw="30"`, script: await bundled("xr_plain.ts") });
    await page.evaluate(() => (window as unknown as { start(...all: unknown[]): Promise<unknown> }).start({ optionalFeatures: ["light-estimation"] }, "rgba16f"));
    await until(page, "look().changes > 0");
    const { estimateMs, newMapMs, sameMapMs } = await page.evaluate((rounds) => (window as unknown as { times(rounds: number): Promise<Times> }).times(rounds), ROUNDS);
    const { texels, ms } = await page.evaluate((rounds) => (window as unknown as { turnMs(rounds: number): { texels: number; ms: number } }).turnMs(rounds), ROUNDS);
    const told = (all: number[]): string => `${all.sort((a, b) => a - b)[Math.floor(all.length / 2)]!.toFixed(3)} (${all.at(-1)!.toFixed(1)})`;
    console.log(`map of ${texels} texels, ms of a frame, median (worst): an estimate ${told(estimateMs)}, the map once more ${told(sameMapMs)}, a new map ${told(newMapMs)} and ${(48 * texels * texels) / 1024} KiB to the graphics processor; when it comes, outside of frames, ${ms.toFixed(3)}`);
    await pages.close();
  }
} finally {
  await browser.close();
  daemon.kill();
  room.kill();
  pages.stop();
}
