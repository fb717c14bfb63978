// SPDX-License-Identifier: Apache-2.0
/** WebXR pages of an app's own server, under an emulated headset (iwer), with the script tag of lightprobe-webxr.js. */
import { readFileSync } from "node:fs";
import { createServer, type Server } from "node:http";
import { resolve } from "node:path";
import { build } from "esbuild";
import type { Browser, Page } from "playwright-core";
import { LONG_MS } from "./chromium.js";
import { ROOT } from "./golden.js";

export const SHIM = resolve(ROOT, "build/js/dist/lightprobe-webxr.js");
const EMULATOR = readFileSync(resolve(ROOT, "build/js/node_modules/iwer/build/iwer.min.js"), "utf8");
/** The emulator (2.5) gives a transform where its own code reads a matrix. */
const MEND = "const { prototype } = XRReferenceSpace, offset = prototype.getOffsetReferenceSpace; prototype.getOffsetReferenceSpace = function (transform) { return offset.call(this, transform.matrix); };";
const HEADSET = `${EMULATOR}; window.headset = new IWER.XRDevice(IWER.metaQuest3); window.headset.installRuntime({ forceInstall: true }); ${MEND}`;

export interface Opened {
  page: Page;
  /** What the page and its shaders complained of. */
  faults: string[];
  /** What the console was told. */
  said: string[];
  /** Addresses that were connected to. */
  sockets: string[];
}

export interface Wanted {
  /** Attributes of the script tag of lightprobe-webxr.js, as HTML; undefined: the page is without it. */
  tag?: string;
  /** Code of the page. */
  script: string;
  /** HTML before the code. */
  body?: string;
  /** Without the emulated headset, as the browser itself is. */
  bare?: boolean;
  host?: string;
  /** Of the page's address. */
  hash?: string;
}

/** The code of test/page/FILE, or of another folder, for a script tag. */
export async function bundled(file: string, more: { nodePaths?: string[]; alias?: Record<string, string>; jsx?: "automatic" } = {}): Promise<string> {
  const { outputFiles } = await build({ entryPoints: [file.startsWith("/") ? file : `test/page/${file}`], bundle: true, write: false, format: "iife", logLevel: "error", ...more });
  return outputFiles[0]!.text;
}

export class Pages {
  #server: Server | undefined;
  readonly #files = new Map<string, string>();
  readonly #open: Page[] = [];
  #count = 0;
  readonly #hasFineClock: boolean;
  port = 0;

  /** `hasFineClock`: pages are isolated, so that the browser tells them the time within 5 µs instead of 100. */
  constructor(hasFineClock = false) {
    this.#hasFineClock = hasFineClock;
  }

  async start(): Promise<this> {
    this.#files.set("/lightprobe-webxr.js", readFileSync(SHIM, "utf8"));
    this.#server = createServer((request, answer) => {
      const path = request.url!.split("?")[0]!, found = this.#files.get(path);
      answer.setHeader("content-type", path.endsWith(".js") ? "text/javascript" : "text/html; charset=utf-8");
      if (this.#hasFineClock) answer.setHeader("cross-origin-opener-policy", "same-origin").setHeader("cross-origin-embedder-policy", "require-corp");
      answer.writeHead(found === undefined ? 404 : 200).end(found);
    });
    await new Promise<void>((done) => { this.#server!.listen(0, "127.0.0.1", done); });
    this.port = (this.#server.address() as { port: number }).port;
    return this;
  }

  get origin(): string {
    return `http://localhost:${this.port}`;
  }

  serve(path: string, text: string): void {
    this.#files.set(path, text);
  }

  /** All pages: each draws as fast as it can. */
  async close(): Promise<void> {
    for (const page of this.#open.splice(0)) await page.close();
  }

  stop(): void {
    this.#server?.close();
    this.#server?.closeAllConnections();
  }

  async open(browser: Browser, { tag, script, body = "", bare = false, host = "localhost", hash = "" }: Wanted): Promise<Opened> {
    const path = `/${++this.#count}`;
    this.serve(`${path}.js`, script);
    this.serve(`${path}.html`, `<!doctype html><link rel="icon" href="data:,"><title>page</title><body>${tag === undefined ? "" : `<script src="lightprobe-webxr.js" ${tag}></script>`}${body}<script src="${path}.js"></script>`);
    const page = await browser.newPage({ viewport: { width: 360, height: 360 } });
    this.#open.push(page);
    const opened: Opened = { page, faults: [], said: [], sockets: [] };
    page.on("pageerror", (error) => opened.faults.push(error.message));
    page.on("console", (message) => opened.said.push(message.text()));
    page.on("websocket", (socket) => opened.sockets.push(socket.url()));
    if (!bare) await page.addInitScript(HEADSET);
    await page.goto(`http://${host}:${this.port}${path}.html${hash}`, { timeout: LONG_MS });
    return opened;
  }
}

/** Like page.waitForFunction, but by a timer: headless pages draw few frames. */
export async function until(page: Page, what: string): Promise<void> {
  await page.waitForFunction(what, null, { timeout: LONG_MS, polling: 50 });
}
