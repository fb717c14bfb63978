// SPDX-License-Identifier: Apache-2.0
// node draw.js FILE.glb right|left mirror|white: samples of a sphere in its light, as JSON.
import { readFileSync } from "node:fs";
import { chromium } from "playwright-core";

const [file, hand, kind] = process.argv.slice(2);
const browser = await chromium.launch({
  executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
  args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"],
});
try {
  const page = await browser.newPage();
  page.on("pageerror", (error) => { throw error; });
  await page.addScriptTag({ path: new URL("page.bundle.js", import.meta.url).pathname });
  const samples = await page.evaluate((all) => window.draw(...all), [readFileSync(file).toString("base64"), hand === "right", kind === "mirror"]);
  process.stdout.write(JSON.stringify(samples));
} finally {
  await browser.close();
}
