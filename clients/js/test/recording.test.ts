// SPDX-License-Identifier: Apache-2.0
/** Recordings in the viewer: what `lightprobe record` writes is read, and played to the client as a probe. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { join, resolve } from "node:path";
import { after, before, test } from "node:test";
import { create, toBinary } from "@bufbuild/protobuf";
import type { Browser, Page } from "playwright-core";
import { Probe, decode, type Estimate } from "../src/index.js";
import * as pb from "../src/gen/lightprobe_pb.js";
import { kindOf } from "../web/files.js";
import { checkSize, readRecording } from "../web/recording.js";
import { playable, replayed } from "../web/replay.js";
import { LONG_MS, launch } from "./chromium.js";
import { LiveDaemon, WEB } from "./daemon.js";
import { ROOT } from "./golden.js";

const daemon = new LiveDaemon();
let bytes: Uint8Array;

before(async () => {
  await daemon.start();
  const file = join(daemon.folder, "room.mcap");
  execFileSync(resolve(ROOT, "build/venv/bin/lightprobe"), ["record", file, "--from", `ws:127.0.0.1:${daemon.port}`, "--seconds", "1.5", "--reflection-map", "32"], { stdio: "ignore" });
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
  const probe = new Probe("ws://recording/", { WebSocket: replayed(playable(recorded)), shOrder: 4 }), found: Estimate[] = [];
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
  const socket = new (replayed(playable(many)))("ws://recording/");
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
  assert.throws(() => playable(recorded.filter((one) => !isLight(one))), /holds no light/);
  assert.throws(() => playable(recorded.filter(isLight)), /no greeting of a probe/);
});

test("what is not a probe's is left out of a message, and a message that is larger than a probe's is not played", () => {
  const recorded = readRecording(bytes), light = recorded.findIndex(({ data }) => decode(data)?.kind === "estimate");
  const changed = (data: Uint8Array): typeof recorded => recorded.map((one, i) => (i === light ? { ...one, data } : one));
  const foreign = Buffer.concat([recorded[light]!.data, ...Array.from({ length: 1000 }, () => Buffer.from([0xf8, 0x7f, 1]))]); // a field 2047
  assert.deepEqual(playable(changed(foreign)).map(({ data }) => data.length), playable(recorded).map(({ data }) => data.length));
  const lights = create(pb.FromProbeSchema, { message: { case: "estimate", value: create(pb.EstimateSchema, { lights: Array.from({ length: 10_000 }, () => ({})) }) } });
  assert.throws(() => playable(changed(toBinary(pb.FromProbeSchema, lights))), /a message of 20 KiB, and a probe's have up to 16: record one with/);
  assert.throws(() => playable(changed(new Uint8Array(2 << 20))), /a message of 2048 KiB, and a probe's have up to 1024/);
});

/** A frame of zstd with one compressed block, which holds `body`. */
function frame(body: number[], unpackedBytes = 1): Buffer {
  const head = 1 | (2 << 1) | (body.length << 3);
  return Buffer.from([0x28, 0xb5, 0x2f, 0xfd, 0x20, unpackedBytes, head & 255, (head >> 8) & 255, head >> 16, ...body]);
}

/** 98 047 sequences that each copy 65 539 bytes: 18 bytes that ask for 6 GB. */
const LONG_FRAME = frame([0x00, 0xff, 0xff, 0xff, 0x54, 0, 0, 52, 1]);
/** Huffman weights whose table has a single symbol, of no bits: one after another, without an end. */
const ENDLESS_FRAME = frame([0x12, 0x40, 0x01, 4, 0xf0, 0x03, 0, 4, 0], 4);
const repeated = (part: Buffer, count: number): Buffer => Buffer.concat(Array.from({ length: count }, () => part));
const file = (...records: Buffer[]): Buffer => Buffer.concat([Buffer.from(MAGIC), ...records, Buffer.from(MAGIC)]);
const recordingWith = (...records: Buffer[]): Buffer => Buffer.concat([bytes.subarray(0, bytes.length - MAGIC.length), ...records]);
/** Blocks of 2 MiB − 1 of one byte, and a last one. */
const RLE_BOMB = Buffer.concat([Buffer.from([0x28, 0xb5, 0x2f, 0xfd, 0, 0x38]), repeated(Buffer.from([0xfa, 0xff, 0xff, 7]), 4000), Buffer.from([0xfb, 0xff, 0xff, 7])]);
const EMPTY_FRAME = Buffer.from([0x28, 0xb5, 0x2f, 0xfd, 0x20, 0, 1, 0, 0]);

const TOO_LONG = /takes too long to read: it is damaged.*Record one with `lightprobe record`: the probe's light stays/;
const NOTHING = /holds no message of a probe.*record one with `lightprobe record`: the probe's light stays/;
/** What each says; nothing: it is played as far as it goes. */
const MADE_UP: [string, () => Buffer, RegExp | undefined][] = [
  ["18 bytes that ask for gigabytes", () => file(chunk("zstd", LONG_FRAME, 1)), TOO_LONG],
  ["a block without an end", () => file(chunk("zstd", ENDLESS_FRAME, 4)), TOO_LONG],
  ["a good recording, and then gigabytes", () => recordingWith(chunk("zstd", LONG_FRAME, 1)), TOO_LONG],
  ["a frame that is cut off", () => file(chunk("zstd", LONG_FRAME.subarray(0, 12), 1)), NOTHING],
  ["blocks that repeat a byte", () => file(chunk("zstd", RLE_BOMB, 16 << 20)), NOTHING],
  ["many frames of nothing", () => file(chunk("zstd", repeated(EMPTY_FRAME, 100_000), 0)), NOTHING],
  ["noise", () => file(chunk("zstd", Buffer.from(Array.from({ length: 5000 }, (_, i) => (i * i * 31 + 7 * i) & 255)), 5000)), NOTHING],
  ["another compression, by a long name", () => file(chunk("lz4".repeat(1_000_000), Buffer.alloc(5), 5)), /compression lz4lz4lz4lz4lz4lz4lz: expected zstd/],
  ["a good recording, and then noise", () => recordingWith(chunk("zstd", Buffer.alloc(500, 3), 500)), undefined],
];

/** Drops a file on the page, which stands still no longer than `longestMs` until it plays it or says what is wrong: what it says. */
async function dropped(page: Page, name: string, data: Buffer): Promise<{ text: string; longestMs: number; takenMs: number }> {
  return page.evaluate(([name, base64]) => new Promise((done) => {
    const transfer = new DataTransfer(), begunMs = performance.now(), status = document.getElementById("status")!, problem = document.getElementById("problem")!;
    transfer.items.add(new File([Uint8Array.from(atob(base64!), (c) => c.charCodeAt(0))], name!));
    document.getElementById("dismiss")!.click();
    document.body.dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
    let beforeMs = performance.now(), longestMs = 0;
    const draw = (): void => {
      const nowMs = performance.now();
      longestMs = Math.max(longestMs, nowMs - beforeMs);
      beforeMs = nowMs;
      if (!problem.hidden) done({ text: problem.textContent!, longestMs, takenMs: nowMs - begunMs });
      else if (status.textContent === `recording ${name}`) done({ text: "", longestMs, takenMs: nowMs - begunMs });
      else requestAnimationFrame(draw);
    };
    requestAnimationFrame(draw);
  }), [name, data.toString("base64")]);
}

/** Far below what the page takes for such a file where it reads it itself, on a busy machine. */
const LONGEST_STILL_MS = 3000;
let browser: Browser | undefined;
after(async () => { await browser?.close(); });

/** The viewer at an address, without the picture, which would take its time. */
async function viewer(address: string): Promise<Page> {
  browser ??= await launch("--disable-3d-apis");
  const page = await browser.newPage();
  await page.goto(address, { timeout: LONG_MS });
  await page.waitForFunction(() => !document.getElementById("problem")!.hidden); // no WebGL
  return page;
}

for (const [what, made, says] of MADE_UP)
  test(`the page goes on, and soon says what is wrong with a recording: ${what}`, { timeout: 2 * LONG_MS }, async () => {
    const page = await viewer(`http://127.0.0.1:${daemon.port}/`), { text, longestMs, takenMs } = await dropped(page, "odd.mcap", made());
    if (says) assert.match(text, new RegExp(`^odd\\.mcap: .*${says.source}`));
    else assert.equal(text, "");
    assert.ok(longestMs < LONGEST_STILL_MS, `the page stood still for ${longestMs.toFixed(0)} ms`);
    assert.ok(takenMs < 20_000, `the page said it after ${takenMs.toFixed(0)} ms`);
    await page.close();
  });

test("a file that is opened meanwhile takes the place of one that is read", { timeout: 2 * LONG_MS }, async () => {
  const page = await viewer(`http://127.0.0.1:${daemon.port}/`), slow = dropped(page, "slow.mcap", file(chunk("zstd", LONG_FRAME, 1)));
  await page.waitForFunction(() => /^slow\.mcap: reading the recording/.test(document.querySelector<HTMLElement>("#work:not([hidden])")?.textContent ?? ""));
  assert.equal((await dropped(page, "room.mcap", Buffer.from(bytes))).text, "");
  slow.catch(() => {}); // it ends with the page
  await page.waitForTimeout(7000); // longer than the slow one may take
  assert.equal(await page.locator("#status").textContent(), "recording room.mcap");
  assert.equal(await page.locator("#problem").isVisible(), false);
  assert.equal(await page.locator("#work").isVisible(), false);
  await page.close();
});

test("from a folder of any web server it plays a recording, too; without reader.js it says what is missing", { timeout: 2 * LONG_MS }, async () => {
  const types: Record<string, string> = { html: "text/html", js: "text/javascript", css: "text/css" };
  let hasReader = true;
  const server = createServer((request, answer) => {
    const name = request.url === "/viewer/" ? "index.html" : request.url!.replace("/viewer/", "");
    if (!/^[a-z]+\.(html|js|css)$/.test(name) || (name === "reader.js" && !hasReader)) return answer.writeHead(404).end();
    return answer.setHeader("content-type", types[name.split(".")[1]!]!).end(readFileSync(join(WEB, name)));
  });
  await new Promise<void>((done) => { server.listen(0, "127.0.0.1", done); });
  const address = `http://127.0.0.1:${(server.address() as { port: number }).port}/viewer/`;
  let page = await viewer(address);
  assert.equal((await dropped(page, "room.mcap", Buffer.from(bytes))).text, "");
  hasReader = false; // as when the probe that serves the page is gone
  assert.equal((await dropped(page, "next.mcap", Buffer.from(bytes))).text, "");
  await page.close();
  page = await viewer(address);
  assert.match((await dropped(page, "again.mcap", Buffer.from(bytes))).text, /^again\.mcap: .*reader\.js, which reads it, did not start: copy all files of the page/);
  await page.close();
  server.close();
});

test("a file is what its name says", () => {
  assert.equal(kindOf("Chair.GLB"), "object");
  assert.equal(kindOf("room.mcap"), "recording");
  assert.throws(() => kindOf("notes.txt"), /objects \(\.glb\) and plays recordings \(\.mcap/);
});
