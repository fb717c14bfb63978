// SPDX-License-Identifier: Apache-2.0
/** `lightprobe demo`, for programs that look at its page. */
import { spawn } from "node:child_process";
import { mkdtempSync, rmSync } from "node:fs";
import { tmpdir } from "node:os";
import { join, resolve } from "node:path";
import { createInterface } from "node:readline";
import type { Page } from "playwright-core";
import { ROOT } from "./golden.js";

/** Resolves when it has printed the address of its page. */
export async function startDemo(...options: string[]): Promise<{ address: string; end: () => void }> {
  const folder = mkdtempSync(join(tmpdir(), "lp-demo-"));
  const demo = spawn(resolve(ROOT, "build/venv/bin/lightprobe"), ["demo", "--every-s", "3600", "--output", folder, ...options], { stdio: ["ignore", "ignore", "pipe"] });
  for await (const line of createInterface({ input: demo.stderr })) {
    const address = /http:\/\/127\S+/.exec(line)?.[0];
    if (!address) continue;
    demo.stderr.resume(); // what it says later is not read
    return {
      address,
      end: () => {
        demo.kill("SIGINT");
        rmSync(folder, { recursive: true, force: true });
      },
    };
  }
  throw new Error("lightprobe demo printed no address");
}

/** The daemon is about to listen when the address is printed. */
export async function open(page: Page, address: string): Promise<void> {
  for (let left = 120; ; left--)
    try {
      await page.goto(address);
      return;
    } catch (error) {
      if (left === 0) throw error;
      await new Promise((done) => setTimeout(done, 500));
    }
}
