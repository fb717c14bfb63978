// SPDX-License-Identifier: Apache-2.0
/** The Worker that reads dropped files: what they hold may take it for ever, and then the page ends it (reading.ts). */
import { readRecording, type Recorded } from "./recording.js";
import { playable } from "./replay.js";

/** Messages one after another in `bytes`; each ends at its `ends`. */
export interface Packed { timesMs: Float64Array; ends: Float64Array; bytes: Uint8Array }

/** What the Worker says. `begun`: it has the file; `done`: how far it is, and for how long honest work may have taken it. */
export type FromReader =
  | { kind: "begun" }
  | { kind: "done"; share: number; allowedMs: number }
  | { kind: "recording"; packed: Packed }
  | { kind: "error"; text: string };

/** A slow phone does as much in a millisecond. */
const BYTES_PER_MS = 4096, MESSAGES_PER_MS = 20;
/** So often it says how far it is. */
const TOLD_PERIOD_MS = 50;
/** Of a text that says what is wrong. */
const MOST_LETTERS = 500;

const say = (what: FromReader, transfer: Transferable[] = []): void => self.postMessage(what, { transfer });

let toldAtMs = -Infinity;
function tell(share: number, allowedMs: number): void {
  if (performance.now() - toldAtMs < TOLD_PERIOD_MS) return;
  toldAtMs = performance.now();
  say({ kind: "done", share, allowedMs });
}

function pack(messages: Recorded[]): Packed {
  const ends = new Float64Array(messages.length);
  let end = 0;
  messages.forEach(({ data }, i) => { ends[i] = end += data.length; });
  const bytes = new Uint8Array(end);
  messages.forEach(({ data }, i) => bytes.set(data, ends[i]! - data.length));
  return { timesMs: Float64Array.from(messages, ({ timeMs }) => timeMs), ends, bytes };
}

/** Two halves: unpacking, then looking at each message. */
function packedRecording(file: Uint8Array): Packed {
  let unpackingMs = 0;
  const recorded = readRecording(file, (share, bytes) => tell(share / 2, unpackingMs = bytes / BYTES_PER_MS));
  return pack(playable(recorded, (count) => tell(0.5 + count / recorded.length / 2, unpackingMs + count / MESSAGES_PER_MS)));
}

async function read(file: File): Promise<void> {
  const bytes = new Uint8Array(await file.arrayBuffer());
  say({ kind: "begun" });
  const packed = packedRecording(bytes);
  say({ kind: "recording", packed }, [packed.timesMs.buffer, packed.ends.buffer, packed.bytes.buffer]);
}

self.onmessage = ({ data: file }: MessageEvent<File>) => {
  read(file).catch((error: unknown) => say({ kind: "error", text: (error instanceof Error ? error.message : String(error)).slice(0, MOST_LETTERS) }));
};
