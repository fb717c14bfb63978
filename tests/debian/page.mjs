// SPDX-License-Identifier: Apache-2.0
/** `page.mjs ADDRESS`: the address of `lightprobe pair` in Chromium: its warning, and then the light. */
import assert from "node:assert/strict";
import { LONG_MS, launch } from "../../build/js/dist/test/chromium.js";

const address = process.argv[2];
const browser = await launch();

/** What keeps Chromium from the page; the daemon may still be starting. */
async function refusal() {
  const page = await browser.newPage();
  for (const end = Date.now() + LONG_MS; ; await new Promise((done) => setTimeout(done, 200))) {
    const error = await page.goto(address).then(() => "", (thrown) => thrown.message);
    if (!error.includes("ERR_CONNECTION_REFUSED") || Date.now() > end) return error;
  }
}

try {
  assert.match(await refusal(), /ERR_CERT_AUTHORITY_INVALID/, "a browser warns: no authority has signed the certificate");
  const context = await browser.newContext({ ignoreHTTPSErrors: true, viewport: { width: 300, height: 400 } }); // the user has accepted the warning
  const page = await context.newPage();
  const faults = [];
  page.on("pageerror", (error) => faults.push(error.message));
  await page.goto(address);
  await page.waitForFunction(() => document.getElementById("left").textContent === "lit by the probe" && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });
  const lamps = await page.locator("#lamps tbody tr").count();
  const status = await page.locator("#status").textContent();
  assert.equal(await page.locator("#connection").isVisible(), false);
  assert.deepEqual(faults, []);
  console.log(`the page of ${new URL(address).host} in Chromium ${browser.version()}: “${status}”, lamps: ${lamps}`);
} finally {
  await browser.close();
}
