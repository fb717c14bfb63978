// SPDX-License-Identifier: Apache-2.0
/** `make web-pictures`: pictures of the viewer of `lightprobe demo`, on a desktop and on a phone. */
import { resolve } from "node:path";
import { LONG_MS, launch } from "./chromium.js";
import { open, startDemo } from "./demo.js";
import { ROOT } from "./golden.js";

/** Lamps have faded in, and all of the glass has been drawn. */
const FRAMES = 40;
const VIEWS = { desktop: { width: 1280, height: 800 }, phone: { width: 390, height: 844 } };

const out = process.env["PICTURES"] ?? resolve(ROOT, "docs/users");
const demo = await startDemo(), browser = await launch();
try {
  for (const [name, viewport] of Object.entries(VIEWS)) {
    const page = await browser.newPage({ viewport, reducedMotion: "reduce" });
    // As a graphics processor would draw it: the page takes this machine for one that draws 60 pictures a second.
    await page.addInitScript(() => {
      const original = requestAnimationFrame.bind(window);
      let nowMs = 0;
      window.requestAnimationFrame = (draw) => original(() => { draw((nowMs += 16)); });
    });
    await open(page, demo.address);
    await page.waitForFunction((frames) => Number(document.body.dataset["frames"]) > frames && document.querySelector("#lamps tbody tr"), FRAMES, { timeout: 5 * LONG_MS });
    const file = resolve(out, `web_${name}.jpg`);
    await page.screenshot({ path: file, type: "jpeg", quality: 85 });
    console.log(`written: ${file}`);
    await page.close();
  }
} finally {
  await browser.close();
  demo.end();
}
