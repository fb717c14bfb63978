// SPDX-License-Identifier: Apache-2.0
/** Recordings in the viewer: what `lightprobe record` writes is read, and played to the client as a probe. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { Probe, decode, type Estimate } from "../src/index.js";
import { kindOf } from "../web/files.js";
import { checkSize, readRecording } from "../web/recording.js";
import { replayed } from "../web/replay.js";
import { LONG_MS } from "./chromium.js";
import { LiveDaemon } from "./daemon.js";
import { ROOT } from "./golden.js";

const daemon = new LiveDaemon();
let bytes: Uint8Array;

before(async () => {
  await daemon.start();
  const file = join(daemon.folder, "room.mcap");
  execFileSync(resolve(ROOT, "build/venv/bin/lightprobe"), ["record", file, "--from", `ws:127.0.0.1:${daemon.port}`, "--seconds", "1.5", "--reflection-map", "32"], { stdio: "ignore" });
  daemon.kill();
  bytes = new Uint8Array(readFileSync(file));
}, { timeout: LONG_MS });

after(() => { daemon.kill(); });

test("a recording of lightprobe record is read: its messages, and when they came", () => {
  const found = readRecording(bytes), kinds = found.map(({ data }) => decode(data)?.kind);
  assert.equal(kinds[0], "hello");
  assert.ok(kinds.filter((kind) => kind === "estimate").length >= 3, kinds.join(" "));
  assert.ok(kinds.includes("reflectionMap"));
  assert.equal(found[0]!.timeMs, 0);
  found.slice(1).forEach(({ timeMs }, i) => assert.ok(timeMs >= found[i]!.timeMs && timeMs < 60_000));
});

test("a recording that is cut off is read as far as it goes; what is none says what to do", () => {
  const whole = readRecording(bytes).length, part = readRecording(bytes.subarray(0, Math.floor(bytes.length * 0.6))).length;
  assert.ok(part > 0 && part < whole, `${part} of ${whole}`);
  assert.throws(() => readRecording(new TextEncoder().encode("no recording")), /no MCAP file: record one with `lightprobe record`/);
  assert.throws(() => readRecording(bytes.subarray(0, 8)), /holds no message of a probe/);
});

const MAGIC = [0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a], CHUNK = 6;

/** A record of MCAP. */
function record(kind: number, content: Uint8Array): Buffer {
  const head = Buffer.alloc(9);
  head[0] = kind;
  head.writeBigUInt64LE(BigInt(content.length), 1);
  return Buffer.concat([head, content]);
}

/** A chunk that says it unpacks to `size` bytes. */
function chunk(compression: string, content: Uint8Array, size = content.length): Buffer {
  const head = Buffer.alloc(16 + 8 + 4 + 4 + compression.length + 8);
  head.writeBigUInt64LE(BigInt(size), 16);
  head.writeUInt32LE(compression.length, 28);
  head.write(compression, 32);
  head.writeBigUInt64LE(BigInt(content.length), 32 + compression.length);
  return record(CHUNK, Buffer.concat([head, content]));
}

/** What is refused stays so after a whole recording, which would else be played as far as it goes. */
function refused(rest: Buffer, why: RegExp): void {
  const whole = bytes.subarray(0, bytes.length - MAGIC.length);
  for (const before of [new Uint8Array(MAGIC), whole]) assert.throws(() => readRecording(Buffer.concat([before, rest])), why);
}

test("chunks within chunks, and more than a tab can play, are refused with what to do", () => {
  refused(chunk("", chunk("", record(0, new Uint8Array()))), /chunk within a chunk.*: record one with `lightprobe record`/);
  refused(Buffer.concat(Array.from({ length: 17 }, () => chunk("zstd", new Uint8Array(), 16 << 20))), /unpacks to more than 256 MiB.*: record a shorter one/);
  refused(Buffer.alloc(9 * 300_001), /more than 300000 messages.*: record a shorter one/);
  assert.throws(() => checkSize(300 * 2 ** 20), /has 300 MiB, .* up to 256 MiB: record a shorter one/);
  checkSize(256 * 2 ** 20);
});

test("a chunk that says it unpacks to more than any recording needs is not unpacked", () => {
  const chunk = new DataView(new ArrayBuffer(8 + 9 + 40));
  bytes.subarray(0, 8).forEach((value, i) => chunk.setUint8(i, value));
  chunk.setUint8(8, 6);
  chunk.setBigUint64(9, 40n, true);
  chunk.setBigUint64(8 + 9 + 16, 1n << 40n, true);
  assert.throws(() => readRecording(new Uint8Array(chunk.buffer)), /unpacks to more than 16 MiB/);
});

test("a client plays it as a probe, again and again, with the times of now and for its own subscription", { timeout: LONG_MS }, async () => {
  const recorded = readRecording(bytes), count = recorded.filter(({ data }) => decode(data)?.kind === "estimate").length;
  const probe = new Probe("ws://recording/", { WebSocket: replayed(recorded), shOrder: 4 }), found: Estimate[] = [];
  await new Promise<void>((done) => probe.on("estimate", (estimate) => {
    found.push(estimate);
    if (found.length === 2) probe.subscribe({ shOrder: 3 });
    if (found.length > count) done();
  }));
  assert.equal(probe.hello?.name, "test room");
  assert.ok(probe.latest() && probe.reflectionMap, "no light, or no map");
  assert.ok(Math.abs(probe.ageMs()! - found.at(-1)!.sendDelayMs) < 1000, `${probe.ageMs()} ms old`);
  assert.equal(probe.notOurs, 0);
  assert.deepEqual([...new Set(found.map(({ subscription }) => subscription))], [1, 2]);
  probe.close();
});

test("however many messages are due, the page has its turn between them", { timeout: LONG_MS }, async () => {
  const recorded = readRecording(bytes), light = recorded.find(({ data }) => decode(data)?.kind === "estimate")!;
  const many = [recorded[0]!, ...Array.from({ length: 1000 }, () => ({ ...light, timeMs: 0 }))];
  const socket = new (replayed(many))("ws://recording/");
  let all = 0, atOnce = 0, most = 0;
  await new Promise<void>((done) => {
    socket.onmessage = () => {
      if (atOnce++ === 0) setImmediate(() => { atOnce = 0; });
      most = Math.max(most, atOnce);
      if (++all === 2001) done();
    };
  });
  socket.close();
  assert.ok(most <= 201, `${most} messages at once`); // and the greeting
});

test("without light or without a greeting it is not played", () => {
  const recorded = readRecording(bytes), isLight = ({ data }: { data: Uint8Array }): boolean => decode(data)?.kind === "estimate";
  assert.throws(() => replayed(recorded.filter((one) => !isLight(one))), /holds no light/);
  assert.throws(() => replayed(recorded.filter(isLight)), /no greeting of a probe/);
});

test("a file is what its name says", () => {
  assert.equal(kindOf("Chair.GLB"), "object");
  assert.equal(kindOf("room.mcap"), "recording");
  assert.throws(() => kindOf("notes.txt"), /objects \(\.glb\) and plays recordings \(\.mcap/);
});
