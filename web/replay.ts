// SPDX-License-Identifier: Apache-2.0
/** Plays a recording to a client of the probe, in place of its connection: again and again, with the times of now. */
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import * as pb from "../src/gen/lightprobe_pb.js";
import type { Recorded } from "./recording.js";

/** Pauses, as of a probe that was away, are not waited out. */
const LONGEST_PAUSE_MS = 2000;
/** Between the end and the next beginning. */
const AGAIN_MS = 50;
/** However many are due: then the page has its turn. */
const MOST_AT_ONCE = 200, MOST_AT_ONCE_MS = 10;
const OPEN = 1, CLOSED = 3;

/** A map of the room has 98 KiB, and every other message less than 8. More would hold the page up whenever it is played. */
const MOST_MAP_BYTES = 1 << 20, MOST_BYTES = 16 << 10;

/** The message, and its bytes without what this protocol does not know; Error for one that is too large. */
function clean({ data }: Recorded): { kind: pb.FromProbe["message"]["case"]; data: Uint8Array } {
  const isSmall = data.length <= MOST_MAP_BYTES, whole = isSmall && fromBinary(pb.FromProbeSchema, data, { readUnknownFields: false });
  const kind = whole ? whole.message.case : undefined, bytes = whole ? toBinary(pb.FromProbeSchema, whole) : data;
  const most = kind === undefined || kind === "reflectionMap" || kind === "polarizationMap" ? MOST_MAP_BYTES : MOST_BYTES;
  if (bytes.length > most) throw new Error(`holds a message of ${Math.ceil(bytes.length / 1024)} KiB, and a probe's have up to ${most >> 10}: record one with \`lightprobe record\``);
  return { kind, data: bytes };
}

/**
 * What is played: the greeting first, then the messages at their times, with pauses shortened. Each is as small as a probe's.
 * Error: there is no light in it. `told`: how many messages are done. No DOM here: a page calls this in a Worker (reader.ts).
 */
export function playable(recorded: Recorded[], told: (count: number) => void = () => {}): Recorded[] {
  let before = 0, atMs = 0, hello: Recorded | undefined, hasLight = false;
  const messages: Recorded[] = [];
  recorded.forEach((one, i) => {
    const { kind, data } = clean(one);
    atMs += Math.min(LONGEST_PAUSE_MS, Math.max(0, one.timeMs - before));
    before = one.timeMs;
    if (kind === "hello") hello ??= { timeMs: 0, data };
    else messages.push({ timeMs: atMs, data });
    hasLight ||= kind === "estimate";
    told(i + 1);
  });
  if (!hello) throw new Error("holds no greeting of a probe: record from its first message on");
  if (!hasLight) throw new Error("holds no light");
  return [hello, ...messages];
}

const messageOf = ({ data }: Recorded): pb.FromProbe["message"] => fromBinary(pb.FromProbeSchema, data).message;

/** As if it had been captured just now, for this subscription. */
function stamped(message: pb.FromProbe["message"], subscription: number): pb.FromProbe["message"] {
  if (message.case !== "estimate" && message.case !== "reflectionMap") return message;
  const delayNs = message.case === "estimate" ? BigInt(message.value.sendDelayUs) * 1000n : 0n;
  Object.assign(message.value, { captureTimeUnixNs: BigInt(Math.round(Date.now() * 1e6)) - delayNs, subscription });
  return message;
}

/** A class that a Probe takes for its WebSocket, of what playable() gives. A message is decoded when it is due. */
export function replayed([hello, ...messages]: Recorded[]): typeof WebSocket {
  const lastMs = messages.at(-1)!.timeMs;

  class ReplaySocket {
    binaryType = "arraybuffer";
    readyState = OPEN;
    onopen: (() => void) | undefined;
    onmessage: ((event: { data: ArrayBuffer }) => void) | undefined;
    onclose: (() => void) | undefined;
    #subscription = 1;
    #timer: ReturnType<typeof setTimeout>;

    constructor() {
      this.#timer = setTimeout(() => {
        this.onopen?.();
        this.#give(messageOf(hello!));
        this.#play(0, performance.now());
      });
    }

    send(data: Uint8Array): void {
      const { message } = fromBinary(pb.FromClientSchema, data);
      if (message.case === "subscribe") this.#subscription = message.value.number;
    }

    close(): void {
      clearTimeout(this.#timer);
      this.readyState = CLOSED;
      this.onclose?.();
    }

    #give(message: pb.FromProbe["message"]): void {
      this.onmessage?.({ data: toBinary(pb.FromProbeSchema, create(pb.FromProbeSchema, { message })).slice().buffer });
    }

    /** Gives what is due, from this message on, in a round that began at `startMs`. */
    #play(next: number, startMs: number): void {
      const begunMs = performance.now(), end = Math.min(messages.length, next + MOST_AT_ONCE);
      for (; next < end && startMs + messages[next]!.timeMs <= begunMs && performance.now() - begunMs < MOST_AT_ONCE_MS; next++)
        this.#give(stamped(messageOf(messages[next]!), this.#subscription));
      if (this.readyState === CLOSED) return;
      if (next === messages.length) [next, startMs] = [0, Math.max(startMs + lastMs + AGAIN_MS, performance.now())]; // a page that slept skips rounds
      this.#timer = setTimeout(() => this.#play(next, startMs), Math.max(0, startMs + messages[next]!.timeMs - performance.now()));
    }
  }
  return ReplaySocket as unknown as typeof WebSocket;
}
