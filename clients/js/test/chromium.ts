// SPDX-License-Identifier: Apache-2.0
/** Headless Chromium with WebGL 2 in software, and pages with our code in them. */
import { build } from "esbuild";
import { chromium, type Browser, type Page } from "playwright-core";

export const LONG_MS = 120_000; // the machine may be busy: never a measure of speed

/** Options of a test that takes long, and is run by `make test-nightly` alone. */
export const NIGHTLY = process.env["NIGHTLY"] ? {} : { skip: "it takes long: make test-nightly-js" };

export async function launch(...more: string[]): Promise<Browser> {
  const browser = await chromium.launch({
    executablePath: process.env["CHROMIUM"] ?? "/usr/bin/chromium",
    ignoreDefaultArgs: ["--hide-scrollbars"], // as users see it
    args: ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist", ...more],
  });
  const newContext = browser.newContext.bind(browser); // newPage() makes one, too
  browser.newContext = async (options) => {
    const context = await newContext(options);
    context.setDefaultTimeout(LONG_MS);
    return context;
  };
  return browser;
}

/** An empty page that has run one of test/page; errors of the page and of its shaders fail the test. */
export async function pageWith(browser: Browser, file: string): Promise<Page> {
  const { outputFiles } = await build({ entryPoints: [`test/page/${file}`], bundle: true, write: false, format: "iife" });
  const page = await browser.newPage();
  page.on("pageerror", (error) => { throw error; });
  page.on("console", (message) => { if (message.type() === "error") throw new Error(message.text()); });
  await page.addScriptTag({ content: outputFiles[0]!.text });
  return page;
}
