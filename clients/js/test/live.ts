// SPDX-License-Identifier: Apache-2.0
/** A live daemon and a browser for all tests of a file. */
import { after, before } from "node:test";
import type { Browser } from "playwright-core";
import { LONG_MS, launch } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";

export interface Live {
  readonly daemon: LiveDaemon;
  /** There as soon as tests run. */
  readonly browser: Browser;
}

/** Both start before the first test of the file, and end after the last. */
export function live(): Live {
  const daemon = new LiveDaemon();
  let browser: Browser | undefined;
  before(async () => {
    await daemon.start();
    browser = await launch();
  }, { timeout: LONG_MS });
  after(async () => {
    await browser?.close();
    daemon.kill();
  });
  return { daemon, get browser() { return browser!; } };
}
