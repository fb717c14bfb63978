// SPDX-License-Identifier: Apache-2.0
/** docs/users/first_light.md: its page, as it is printed, served by a live daemon to Chromium. */
import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { cpSync, mkdtempSync, readFileSync, symlinkSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { test } from "node:test";
import { build } from "esbuild";
import { LONG_MS, launch } from "./chromium.js";
import { DAEMON, freePort, panorama } from "./daemon.js";
import { ROOT } from "./golden.js";

const PAGE = readFileSync(resolve(ROOT, "docs/users/first_light.md"), "utf8");

/** The one block of this language in the part about three.js; other engines' are run by components.ts. */
function block(language: string): string {
  const [part] = PAGE.split("## A web page with three.js")[1]!.split("\n## ");
  const found = [...part!.matchAll(new RegExp("```" + language + "\\n(.*?)```", "gs"))];
  assert.equal(found.length, 1, `blocks of ${language}`);
  return found[0]![1]!;
}

/** A folder as the page makes it, with what npm would copy into it. */
function app(): string {
  const folder = mkdtempSync(join(tmpdir(), "lp-first-")), modules = join(folder, "node_modules");
  for (const part of ["package.json", "dist/src"])
    cpSync(resolve(ROOT, "build/js", part), join(modules, "lightprobe", part), { recursive: true });
  for (const name of ["three", "@bufbuild"])
    symlinkSync(resolve(ROOT, "build/js/node_modules", name), join(modules, name));
  writeFileSync(join(folder, "index.html"), block("html"));
  writeFileSync(join(folder, "main.js"), block("js"));
  writeFileSync(join(folder, "room.pfm"), panorama(96));
  return folder;
}

test("the page with three.js shows a ball, lit from the right", { timeout: 2 * LONG_MS }, async () => {
  const folder = app(), port = await freePort();
  await build({ entryPoints: [join(folder, "main.js")], bundle: true, outfile: join(folder, "bundle.js"), format: "iife" });
  const daemon = spawn(DAEMON, [`--source=file:${join(folder, "room.pfm")}?rate=30`, `--publish=ws:127.0.0.1:${port}?root=${folder}`, "--ttl-ms=600000"],
    { stdio: ["ignore", "ignore", "inherit"] });
  const browser = await launch();
  try {
    const page = await browser.newPage(), faults: string[] = [];
    page.on("pageerror", (error) => faults.push(error.message));
    for (let i = 0; i < 100; i++) // until the daemon listens
      if (await page.goto(`http://127.0.0.1:${port}/`).then(() => true, () => false)) break;
      else await new Promise((done) => setTimeout(done, 100));
    const sample = (): Promise<number[]> => page.evaluate(() => new Promise<number[]>((done) => requestAnimationFrame(() => {
      const small = new OffscreenCanvas(64, 64).getContext("2d")!;
      small.drawImage(document.querySelector<HTMLCanvasElement>("#view")!, 0, 0, 64, 64);
      const at = (x: number, y: number): number => small.getImageData(x, y, 1, 1).data[1]!;
      done([at(1, 1), at(39, 21), at(25, 35)]); // aside; the ball's upper right and lower left
    })));
    let seen: number[] = [];
    for (let i = 0; i < 200 && !(seen[1]! > 20 && seen[1]! > 1.3 * seen[2]!); i++) seen = await sample();
    assert.ok(seen[1]! > 20 && seen[1]! > 1.3 * seen[2]!, `aside, right, left: ${String(seen)}`);
    assert.ok(seen[0]! < 5, "the background is lit");
    assert.deepEqual(faults, []);
  } finally {
    await browser.close();
    daemon.kill();
  }
});
