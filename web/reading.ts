// SPDX-License-Identifier: Apache-2.0
/** Reads files in a Worker, so that the page goes on drawing whatever a file holds, and ends one that takes too long. */
import type { FromReader, Packed } from "./reader.js";
import type { Recorded } from "./recording.js";

/** A reader may take so much longer than a slow phone for honest work. */
const MOST_MS = 5000;
const TICK_MS = 100;
/** A tick counts as so much at most: a page that was held up itself, or a computer that slept, is no fault of the file. */
const MOST_TICK_MS = 500;
const TOO_LONG = "takes too long to read: it is damaged, or made to hold this page up. Record one with `lightprobe record`";
const NOT_STARTED = "the page's own file reader.js, which reads it, did not start: copy all files of the page beside it, and reload the page";

/** Started before it is needed: the probe that serves the page may be gone when a recording is opened. */
let idle: Worker | undefined = started();

function started(): Worker {
  return waiting(new Worker(new URL("reader.js", document.baseURI)));
}

/** One that fails while it waits is not taken. */
function waiting(worker: Worker): Worker {
  worker.onmessage = null;
  worker.onerror = () => { if (idle === worker) idle = undefined; };
  return worker;
}

/** The one that reads now: a file that is opened meanwhile takes its place. */
let stop = (): void => {};

function unpack({ timesMs, ends, bytes }: Packed): Recorded[] {
  return Array.from(timesMs, (timeMs, i) => ({ timeMs, data: bytes.subarray(i === 0 ? 0 : ends[i - 1]!, ends[i]!) }));
}

/** Calls `end` when the clock, which begins with `begin`, is past what is allowed. */
class Clock {
  #allowedMs = MOST_MS;
  #takenMs = 0;
  #timer: ReturnType<typeof setInterval> | undefined;

  begin(end: () => void): void {
    let beforeMs = performance.now();
    this.#timer = setInterval(() => {
      const nowMs = performance.now();
      this.#takenMs += Math.min(MOST_TICK_MS, nowMs - beforeMs);
      beforeMs = nowMs;
      if (this.#takenMs > this.#allowedMs) end();
    }, TICK_MS);
  }

  allow(moreMs: number): void {
    this.#allowedMs = MOST_MS + moreMs;
  }

  stop(): void {
    clearInterval(this.#timer);
  }
}

/**
 * What is played of a recording (playable() of replay.ts); undefined: another file was opened meanwhile. Error: what is wrong with it.
 * `told`: the share that is done.
 */
export function readInWorker(file: File, told: (share: number) => void): Promise<Recorded[] | undefined> {
  stop();
  const worker = idle ?? started(), clock = new Clock();
  let isFree = false;
  idle = undefined;
  const end = (): void => {
    clock.stop();
    if (!isFree) worker.terminate();
    idle = isFree ? waiting(worker) : started();
  };
  return new Promise<Recorded[] | undefined>((done, failed) => {
    stop = () => done(undefined);
    worker.onerror = (event) => failed(new Error(event.message || NOT_STARTED));
    worker.onmessage = ({ data }: MessageEvent<FromReader>) => {
      isFree = data.kind === "error" || data.kind === "recording";
      if (data.kind === "begun") clock.begin(() => failed(new Error(TOO_LONG)));
      else if (data.kind === "error") failed(new Error(data.text));
      else if (data.kind === "recording") done(unpack(data.packed));
      else {
        clock.allow(data.allowedMs);
        told(data.share);
      }
    };
    worker.postMessage(file);
  }).finally(end);
}
