// SPDX-License-Identifier: Apache-2.0
/**
 * `make soak-page MINUTES=60`: the viewer of `lightprobe demo` in a Chromium tab, live all the time. Once a minute it prints what
 * the tab holds after a garbage collection. Exit 1: the last third holds more than the third before it.
 */
import { readFileSync, readdirSync } from "node:fs";
import type { CDPSession } from "playwright-core";
import { launch } from "./chromium.js";
import { open, startDemo } from "./demo.js";

const MINUTES = Number(process.env["MINUTES"] ?? 60);
/** Of what the heap may differ between thirds: a collection does not find everything at once. */
const MOST_GROWTH = 0.05;
/** A small picture: the page draws without a graphics processor here. */
const VIEWPORT = { width: 360, height: 240 };

interface Sample { minute: number; heapMib: number; nodes: number; listeners: number; residentMib: number; frames: number; estimates: number }

const statusOf = (id: string, name: string): number => Number(new RegExp(`${name}:\\s+(\\d+)`).exec(readFileSync(`/proc/${id}/status`, "utf8"))?.[1] ?? 0);

/** Whether this program has started a process, or one that started it. */
function isOurs(id: string): boolean {
  for (let at = id; at !== "0"; at = String(statusOf(at, "PPid"))) if (at === String(process.pid)) return true;
  return false;
}

/** Resident memory of the tab's process and the one that draws, MiB. */
function residentMib(): number {
  let kib = 0;
  for (const id of readdirSync("/proc").filter((name) => /^\d+$/.test(name)))
    try {
      if (/--type=(renderer|gpu-process)/.test(readFileSync(`/proc/${id}/cmdline`, "utf8")) && isOurs(id)) kib += statusOf(id, "VmRSS");
    } catch { /* it has ended */ }
  return kib / 1024;
}

async function take(session: CDPSession, minute: number, seen: () => Promise<{ frames: number; estimates: number }>): Promise<Sample> {
  await session.send("HeapProfiler.collectGarbage");
  const { metrics } = await session.send("Performance.getMetrics");
  const of = (name: string): number => metrics.find((one) => one.name === name)?.value ?? NaN;
  return { minute, heapMib: of("JSHeapUsedSize") / 2 ** 20, nodes: of("Nodes"), listeners: of("JSEventListeners"), residentMib: residentMib(), ...await seen() };
}

const mean = (samples: Sample[], of: (one: Sample) => number): number => samples.reduce((sum, one) => sum + of(one), 0) / samples.length;

function isFlat(samples: Sample[]): boolean {
  const third = Math.floor(samples.length / 3), before = samples.slice(third, 2 * third), last = samples.slice(2 * third);
  const grows = (of: (one: Sample) => number): boolean => mean(last, of) > (1 + MOST_GROWTH) * mean(before, of);
  return third > 0 && !grows((one) => one.heapMib) && !grows((one) => one.nodes) && !grows((one) => one.listeners) && !grows((one) => one.residentMib);
}

const demo = await startDemo();
const browser = await launch();
const samples: Sample[] = [];
try {
  const page = await browser.newPage({ viewport: VIEWPORT });
  const faults: string[] = [];
  page.on("pageerror", (error) => faults.push(error.message));
  await open(page, demo.address);
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable");
  const seen = (): Promise<{ frames: number; estimates: number }> => page.evaluate(() => ({
    frames: Number(document.body.dataset["frames"] ?? 0), estimates: Number(document.body.dataset["sequence"] ?? 0),
  }));
  console.log("minute  heap MiB  nodes  listeners  resident MiB  pictures  estimates");
  for (let minute = 1; minute <= MINUTES; minute++) {
    await page.waitForTimeout(60_000);
    const one = await take(session, minute, seen);
    samples.push(one);
    console.log(`${String(minute).padStart(6)}  ${one.heapMib.toFixed(2).padStart(8)}  ${String(one.nodes).padStart(5)}  ${String(one.listeners).padStart(9)}  ${one.residentMib.toFixed(0).padStart(12)}  ${String(one.frames).padStart(8)}  ${String(one.estimates).padStart(9)}`);
  }
  const grew = samples.length > 2 && !isFlat(samples);
  const stood = samples.length > 1 && samples.at(-1)!.estimates <= samples.at(-2)!.estimates;
  if (grew) console.error("soak-page: the tab holds more in the last third than before");
  if (stood) console.error("soak-page: the last minute brought no estimate");
  for (const fault of new Set(faults)) console.error(`soak-page: ${fault}`);
  process.exitCode = grew || stood || faults.length ? 1 : 0;
} finally {
  await browser.close();
  demo.end();
}
