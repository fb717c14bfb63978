// SPDX-License-Identifier: Apache-2.0
/** The page of `lightprobe pair --hand-out` in Chromium: a person presses its button, and has the address. */
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { once } from "node:events";
import { mkdtempSync, readFileSync, rmSync } from "node:fs";
import { createServer, type AddressInfo } from "node:net";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import { test } from "node:test";
import { LONG_MS, launch } from "./chromium.js";
import { ROOT } from "./golden.js";

/** A port that nobody uses now. */
async function freePort(): Promise<number> {
  const server = createServer().listen(0);
  await once(server, "listening");
  const { port } = server.address() as AddressInfo;
  server.close();
  await once(server, "close");
  return port;
}

test("a browser that presses the button has the address, once", { timeout: 2 * LONG_MS }, async () => {
  const folder = mkdtempSync(join(tmpdir(), "lp-pair-")), port = await freePort();
  const words = ["pair", "--dir", join(folder, "pair"), "--hand-out", "100", "--hand-out-port", `${port}`];
  const command = spawn(resolve(ROOT, "build/venv/bin/lightprobe"), words, { stdio: ["ignore", "pipe", "inherit"] });
  const ended = once(command, "exit"), browser = await launch();
  try {
    await once(createInterface(command.stdout), "line");
    const page = await browser.newPage({ ignoreHTTPSErrors: true });
    for (let left = 100; left; left--) {
      const answer = await page.goto(`https://127.0.0.1:${port}/`).catch(() => undefined);
      if (answer) break;
      await new Promise((done) => setTimeout(done, 200));
    }
    await page.getByRole("button", { name: "Pair this device" }).click();
    const link = await page.getByRole("link", { name: "The light of this probe" }).getAttribute("href");
    assert.ok(link!.includes(readFileSync(join(folder, "pair", "token"), "utf8").trim()));
    assert.deepEqual(await ended, [0, null]);
  } finally {
    await browser.close();
    command.kill();
    rmSync(folder, { recursive: true });
  }
});
