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
const MOST_AT_ONCE = 200;
const OPEN = 1, CLOSED = 3;

interface Played { atMs: number; message: pb.FromProbe["message"] }

/** With pauses shortened; what says hello comes once, before all else. Error: there is no light in it. */
function played(recorded: Recorded[]): { hello: pb.FromProbe; messages: Played[] } {
  let before = 0, atMs = 0, hello: pb.FromProbe | undefined;
  const messages: Played[] = [];
  for (const { timeMs, data } of recorded) {
    const whole = fromBinary(pb.FromProbeSchema, data);
    atMs += Math.min(LONGEST_PAUSE_MS, Math.max(0, timeMs - before));
    before = timeMs;
    if (whole.message.case === "hello") hello ??= whole;
    else messages.push({ atMs, message: whole.message });
  }
  if (!hello) throw new Error("holds no greeting of a probe: record from its first message on");
  if (!messages.some(({ message }) => message.case === "estimate")) throw new Error("holds no light");
  return { hello, messages };
}

/** As if it had been captured just now, for this subscription. */
function stamped(message: pb.FromProbe["message"], subscription: number): pb.FromProbe["message"] {
  if (message.case !== "estimate" && message.case !== "reflectionMap") return message;
  const delayNs = message.case === "estimate" ? BigInt(message.value.sendDelayUs) * 1000n : 0n;
  Object.assign(message.value, { captureTimeUnixNs: BigInt(Math.round(Date.now() * 1e6)) - delayNs, subscription });
  return message;
}

/** A class that a Probe takes for its WebSocket. Error: the recording has no light. */
export function replayed(recorded: Recorded[]): typeof WebSocket {
  const { hello, messages } = played(recorded), lastMs = messages.at(-1)!.atMs;

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
        this.#give(hello.message);
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
      const nowMs = performance.now() - startMs, end = Math.min(messages.length, next + MOST_AT_ONCE);
      for (; next < end && messages[next]!.atMs <= nowMs; next++) this.#give(stamped(messages[next]!.message, this.#subscription));
      if (this.readyState === CLOSED) return;
      if (next === messages.length) [next, startMs] = [0, Math.max(startMs + lastMs + AGAIN_MS, performance.now())]; // a page that slept skips rounds
      this.#timer = setTimeout(() => this.#play(next, startMs), Math.max(0, startMs + messages[next]!.atMs - performance.now()));
    }
  }
  return ReplaySocket as unknown as typeof WebSocket;
}
