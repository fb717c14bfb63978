// SPDX-License-Identifier: Apache-2.0
/** The address of `lightprobe pair` of an installed system in Chromium: TLS, the certificate's warning, the token; and a tab that is frozen. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { rmSync, symlinkSync } from "node:fs";
import { join } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import { LONG_MS, NIGHTLY, launch } from "./chromium.js";
import { LiveDaemon, freePort } from "./daemon.js";
import { ROOT } from "./golden.js";

let browser: Browser, url = "";
const daemon = new LiveDaemon();

before(async () => {
  const { folder } = daemon, prefix = join(folder, "usr"), root = join(folder, "root");
  // Everything lies where it says that it does: the prefix leads into the folder that stands for /.
  execFileSync("make", ["-s", "-C", ROOT, "install", `DESTDIR=${root}`, `PREFIX=${prefix}`], { env: { ...process.env, MAKEFLAGS: "" } });
  symlinkSync(join(root, prefix), prefix);
  daemon.port = await freePort();
  const told = execFileSync(join(prefix, "bin/lightprobe"), ["pair", "--dir", join(folder, "pair"), "--host", "127.0.0.1", "--port", String(daemon.port), "--json"],
    { env: { ...process.env, PATH: `${prefix}/bin:${process.env["PATH"]}` } });
  const { url: address, publish, next } = JSON.parse(told.toString()) as { url: string; publish: string; next: string };
  assert.equal(next, `${prefix}/bin/lightprobed --source=v4l2: '${publish}'`.replace(/'--publish=/, "--publish='"));
  url = address;
  daemon.program = join(prefix, "bin/lightprobed");
  await daemon.start(() => publish.replace("--publish=", ""));
  browser = await launch();
}, { timeout: LONG_MS });

after(async () => {
  await browser?.close();
  daemon.kill();
  rmSync(daemon.folder, { recursive: true });
});

/** A tab whose user has accepted the warning. */
async function accepted(address: string): Promise<Page> {
  const context = await browser.newContext({ ignoreHTTPSErrors: true, viewport: { width: 300, height: 400 } });
  const page = await context.newPage();
  await page.goto(address, { timeout: LONG_MS });
  return page;
}

const connected = (page: Page): Promise<unknown> => page.waitForFunction(() => document.getElementById("status")!.textContent === "test room" && document.querySelector("#lamps tbody tr"), null, { timeout: LONG_MS });

test("the browser warns before it opens the address", { timeout: LONG_MS }, async () => {
  const page = await browser.newPage();
  await assert.rejects(page.goto(url), /ERR_CERT_AUTHORITY_INVALID/);
  await page.close();
});

test("with the whole address of lightprobe pair the light comes", { timeout: 2 * LONG_MS }, async () => {
  assert.match(url, /^https:\/\/127\.0\.0\.1:\d+\/#token=/);
  const page = await accepted(url);
  await connected(page);
  assert.equal(await page.locator("#connection").isVisible(), false);
  await page.context().close();
});

for (const [name, spoil] of [["without the token", /#.*/], ["with another token", /token=[^&]*/]] as const)
  test(`${name} the page gets nothing, and says what to do`, { timeout: 2 * LONG_MS }, async () => {
    const page = await accepted(url.replace(spoil, name === "without the token" ? "" : "token=AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA"));
    await page.waitForFunction(() => /the token is missing or wrong — open the address that lightprobe pair prints/.test(document.getElementById("connection")!.textContent ?? ""), null, { timeout: LONG_MS });
    assert.ok(await page.locator("#connection").isVisible());
    assert.equal(await page.locator("#lamps tbody tr").count(), 0);
    await page.context().close();
  });

test("a tab that is frozen for ten seconds shows the newest light when it goes on", { timeout: 3 * LONG_MS, ...NIGHTLY }, async () => {
  const page = await accepted(url);
  await connected(page);
  const sequence = (): Promise<number> => page.evaluate(() => Number(document.body.dataset["sequence"]));
  const session = await page.context().newCDPSession(page), before = await sequence();
  await session.send("Page.setWebLifecycleState", { state: "frozen" });
  await new Promise((done) => setTimeout(done, 10_000));
  await session.send("Page.setWebLifecycleState", { state: "active" });
  await page.waitForFunction((wanted) => Number(document.body.dataset["sequence"]) > wanted, before + 100, { timeout: LONG_MS }); // of some 300
  await connected(page);
  await page.context().close();
});
