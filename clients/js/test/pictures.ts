// SPDX-License-Identifier: Apache-2.0
/** `make web-pictures`: pictures of the viewer in a real room (CC0 panorama), on a desktop in dark and on a phone in light, split. */
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import type { Page } from "playwright-core";
import { LONG_MS, launch } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";
import { ROOT } from "./golden.js";

/** All has been drawn, and the reflection map is what metal shows. */
const FRAMES = 24;
const VIEWS = {
  desktop: { viewport: { width: 1100, height: 640 }, colorScheme: "dark", split: false },
  phone: { viewport: { width: 360, height: 740 }, colorScheme: "light", split: true },
} as const;
const SCENES = process.env["LIGHTPROBE_SCENES"] ?? resolve(ROOT, "build/scenes");
const TO_PFM = "import sys; from lightprobe.imaging import exr, image; image.write_pfm(sys.argv[2], exr.read(__import__('pathlib').Path(sys.argv[1])).radiance[..., :3].clip(0))";

async function drawn(page: Page): Promise<void> {
  const before = await page.evaluate(() => Number(document.body.dataset["frames"]));
  await page.waitForFunction((frames) => Number(document.body.dataset["frames"]) > frames, before + FRAMES, { timeout: 5 * LONG_MS });
}

const out = process.env["PICTURES"] ?? resolve(ROOT, "docs/users"), daemon = new LiveDaemon();
execFileSync(resolve(ROOT, "build/venv/bin/python"), ["-c", TO_PFM, join(SCENES, "interior.exr"), join(daemon.folder, "scene.pfm")]);
daemon.picture = readFileSync(join(daemon.folder, "scene.pfm"));
await daemon.start();
const browser = await launch();
try {
  for (const [name, { viewport, colorScheme, split }] of Object.entries(VIEWS)) {
    const page = await browser.newPage({ viewport, colorScheme, reducedMotion: "reduce" });
    // As a graphics processor would draw it: the page takes this machine for one that draws 50 pictures a second.
    await page.addInitScript(() => {
      const original = requestAnimationFrame.bind(window);
      let nowMs = 0;
      window.requestAnimationFrame = (draw) => original(() => { draw((nowMs += 20)); });
    });
    await page.goto(`http://127.0.0.1:${daemon.port}/`, { timeout: LONG_MS });
    await page.waitForFunction(() => document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
    if (split) await page.locator("#use-main").check({ force: true });
    await drawn(page);
    const file = resolve(out, `web_${name}.jpg`);
    await page.screenshot({ path: file, type: "jpeg", quality: 85, timeout: LONG_MS });
    console.log(`written: ${file}`);
    await page.close();
  }
} finally {
  await browser.close();
  daemon.kill();
}
