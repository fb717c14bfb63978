// SPDX-License-Identifier: Apache-2.0
import assert from "node:assert/strict";
import { test, type TestContext } from "node:test";
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { Probe, WireError, parseAddress } from "../src/index.js";
import { whyUnanswered } from "../src/unanswered.js";
import * as pb from "../src/gen/lightprobe_pb.js";

/** A WebSocket whose other end is the test. */
class Scripted {
  static all: Scripted[] = [];
  readyState = 0;
  binaryType = "blob";
  sent: pb.Subscription[] = [];
  poses: pb.Pose[] = [];
  pings: pb.Ping[] = [];
  onopen?: () => void;
  onclose?: () => void;
  onmessage?: (event: { data: unknown }) => void;
  constructor(readonly url: string, readonly protocols: string[]) { Scripted.all.push(this); }
  send(data: Uint8Array): void {
    const { message } = fromBinary(pb.FromClientSchema, data);
    if (message.case === "subscribe") this.sent.push(message.value);
    if (message.case === "pose") this.poses.push(message.value);
    if (message.case === "ping") this.pings.push(message.value);
  }
  close(): void { this.readyState = 3; this.onclose?.(); }
  open(): void { this.readyState = 1; this.onopen?.(); }
  say(message: pb.FromProbe["message"]): void {
    const data = toBinary(pb.FromProbeSchema, create(pb.FromProbeSchema, { message }));
    this.onmessage?.({ data: data.slice().buffer });
  }
  hello(bootId = 1, protocolMajor = 1, protocolMinor = 3): void {
    this.say({ case: "hello", value: create(pb.HelloSchema, { protocolMajor, protocolMinor, bootId, software: "test" }) });
  }
  estimate(sequence: number, subscription = 1, ttlMs = 60000, ageMs = 0, sendDelayMs = ageMs): void {
    this.say({ case: "estimate", value: create(pb.EstimateSchema, {
      sequence, subscription, ttlMs, bootId: 1, captureTimeUnixNs: BigInt(Math.round(Date.now() - ageMs)) * 1_000_000n, sendDelayUs: sendDelayMs * 1000,
      sh: create(pb.SphericalHarmonicsSchema, { kind: 1, order: 0, coefficients: [1, 1, 1] }),
    }) });
  }
}

function open(options: object = {}, address = "ws://probe:1/"): { probe: Probe; socket: () => Scripted; sequences: number[] } {
  Scripted.all = [];
  const probe = new Probe(address, { WebSocket: Scripted as unknown as typeof WebSocket, healthPeriodMs: 0, ...options });
  const sequences: number[] = [];
  probe.on("estimate", (estimate) => sequences.push(estimate.sequence));
  return { probe, socket: () => Scripted.all.at(-1)!, sequences };
}

const until = async (condition: () => boolean): Promise<void> => {
  for (let k = 0; k < 3000 && !condition(); k++) await new Promise((done) => setTimeout(done, 10));
  assert.ok(condition(), condition.toString());
};

/** setTimeout and setInterval whose time is the test's. Node.js 18 (Debian 12) has none that work. */
class Timers {
  #now = 0;
  #last = 0;
  readonly #waiting = new Map<number, { at: number; period: number; run: () => void }>();

  constructor({ mock }: TestContext) {
    const start = (run: () => void, at: number, period: number): number => {
      this.#waiting.set(++this.#last, { at: this.#now + at, period, run });
      return this.#last;
    };
    const stop = (id: number): void => { this.#waiting.delete(id); };
    const replace = (name: "setTimeout" | "setInterval" | "clearTimeout" | "clearInterval", by: unknown): void => { mock.method(globalThis, name, by as typeof setTimeout); };
    replace("setTimeout", (run: () => void, ms: number) => start(run, ms, 0));
    replace("setInterval", (run: () => void, ms: number) => start(run, ms, ms));
    replace("clearTimeout", stop);
    replace("clearInterval", stop);
  }

  /** Lets so much time pass. */
  tick(ms: number): void {
    const end = this.#now + ms;
    for (;;) {
      const [next] = [...this.#waiting].filter(([, { at }]) => at <= end).sort(([, one], [, other]) => one.at - other.at);
      if (!next) break;
      const [id, timer] = next;
      this.#now = timer.at;
      if (timer.period > 0) timer.at += timer.period;
      else this.#waiting.delete(id);
      timer.run();
    }
    this.#now = end;
  }
}

test("what a listener throws is the app's, and costs neither the connection nor other listeners", (context) => {
  const thrown: unknown[] = [], mistakes = ["state", "hello", "estimate", "health", "reflectionMap"].map((kind) => new WireError(kind));
  context.mock.method(globalThis, "queueMicrotask", (job: () => void) => { try { job(); } catch (error) { thrown.push(error); } });
  const timers = new Timers(context);
  const { probe, socket } = open({ healthPeriodMs: 1000, reflectionMap: { size: 16 } }), others: string[] = [];
  for (const mistake of mistakes) {
    const kind = mistake.message as "state";
    probe.on(kind, () => { throw mistake; });
    probe.on(kind, () => { others.push(kind); });
  }
  const first = socket();
  first.open();
  first.hello();
  first.estimate(1);
  first.say({ case: "health", value: create(pb.HealthSchema, {}) });
  first.say({ case: "reflectionMap", value: create(pb.ReflectionMapSchema, { subscription: 1, kind: 2, size: 16, scale: 1, texels: new Uint8Array(24 * 256) }) });
  assert.deepEqual(others, ["state", "hello", "estimate", "health", "reflectionMap"]);
  assert.deepEqual(thrown, mistakes); // the very errors
  assert.deepEqual([probe.state, probe.lastError, first.readyState, Scripted.all.length], ["open", undefined, 1, 1]);
  first.close(); // lost: it connects again, whatever the listener of "state" throws
  timers.tick(1000);
  assert.equal(Scripted.all.length, 2);
  probe.close();
  assert.equal(probe.state, "closed");
});

test("after a refused token it waits more than a minute, after another refusal not", (context) => {
  const timers = new Timers(context);
  const { probe, socket } = open({}, "https://probe.local:7702/#token=abc");
  for (const [code, soonest, latest] of [[-87, 0, 1000], [-13, 60_000, 120_000], [-87, 0, 10_000], [-13, 60_000, 120_000]] as const) {
    const refused = socket(), before = Scripted.all.length;
    refused.open();
    refused.say({ case: "error", value: create(pb.ErrorSchema, { code, text: "it says why" }) });
    refused.close();
    assert.equal(probe.lastError, "wss://probe.local:7702/: it says why");
    timers.tick(soonest);
    assert.equal(Scripted.all.length, before);
    timers.tick(latest - soonest);
    assert.equal(Scripted.all.length, before + 1);
  }
  probe.close();
});

test("where TLS may be in the way, it is said how to see it", async () => {
  const { probe, socket } = open({}, "https://probe.local:7702/#token=abc");
  socket().close();
  await until(() => probe.lastError !== undefined);
  assert.match(probe.lastError!, /accept the probe's certificate \(open https:\/\/probe\.local:7702\/ to see\)\?$/);
  probe.close();
  const plain = open({}, "ws://probe.local:7701/");
  plain.socket().close();
  assert.match(plain.probe.lastError!, /is lightprobed running\?$/, "outside of browsers there are no origins");
  plain.probe.close();
});

test("a page of another origin is told how to be allowed", () => {
  const dev = "http://localhost:5173";
  assert.equal(whyUnanswered("ws://127.0.0.1:7701/", dev),
    `ws://127.0.0.1:7701/: connect: no answer: is lightprobed running, and may pages of ${dev} read it: start lightprobed with ?origins=${dev} at the end of its --publish=ws:…?`);
  assert.match(whyUnanswered("wss://probe.local:7702/", dev), /certificate \(open https:\/\/probe\.local:7702\/ to see\), and may pages of .*\?origins=http:\/\/localhost:5173 .*--publish=wss:/);
  assert.match(whyUnanswered("ws://127.0.0.1:7701/", "null"), /refuses pages of files: serve this one by http:/);
  for (const own of ["ws://probe:1/", "wss://probe:1/"]) assert.doesNotMatch(whyUnanswered(own, own.replace("ws", "http").slice(0, -1)), /origins/);
});

test("addresses: of the messages, and of the page", () => {
  assert.deepEqual(parseAddress("ws://127.0.0.1:7701/"), { url: "ws://127.0.0.1:7701/", token: undefined });
  assert.deepEqual(parseAddress("https://probe.local:7702/?x=1#token=abc&sha256=12"), { url: "wss://probe.local:7702/", token: "abc" });
  for (const broker of ["mqtt://broker/room", "mqtts://me:secret@broker:8883/room"])
    assert.throws(() => parseAddress(broker), (error: Error) => /no MQTT broker: take the probe's own address/.test(error.message) && !error.message.includes("secret"), broker);
  for (const wrong of ["", "probe", "ftp://x/", "tcp:127.0.0.1:7700"]) assert.throws(() => parseAddress(wrong), TypeError, wrong);
});

test("what the daemon prints is an address; what it listens on for all is none", () => {
  assert.equal(parseAddress("ws:127.0.0.1:7701?clients=7").url, "ws://127.0.0.1:7701/");
  for (const all of ["ws://0.0.0.0:7701/", "ws:0.0.0.0:7701", "ws://[::]:7701/"]) assert.throws(() => parseAddress(all), /stands for all addresses of the probe's machine/, all);
});

test("a token goes over TLS alone, whatever the host", () => {
  for (const clear of ["http://probe:7701/#token=secret", "ws://probe:7701/#token=secret", "ws://127.0.0.1/#sha256=1&token=secret"]) {
    assert.throws(() => parseAddress(clear), (error: Error) => /would send the token in clear.*https: or wss:/.test(error.message) && !error.message.includes("secret"), clear);
  }
  assert.equal(parseAddress("wss://probe/#token=secret").token, "secret");
});

test("reflection maps of the newest subscription arrive, others are dropped", () => {
  const { probe, socket } = open({ reflectionMap: { size: 16, kind: "AMBIENT" } }), seen: number[] = [];
  const map = (sequence: number, subscription: number): void => socket().say({ case: "reflectionMap", value: create(pb.ReflectionMapSchema, {
    sequence, subscription, kind: 1, size: 16, scale: 2, texels: new Uint8Array(24 * 256),
  }) });
  probe.on("reflectionMap", ({ sequence }) => seen.push(sequence));
  socket().open();
  socket().hello();
  assert.deepEqual([socket().sent[0]!.reflectionMap?.size, socket().sent[0]!.reflectionMap?.kind], [16, 1]);
  map(1, 0);
  assert.deepEqual(seen, []);
  map(2, 1);
  probe.subscribe({ reflectionMap: undefined });
  assert.equal(socket().sent[1]!.reflectionMap, undefined);
  map(3, 1); // on its way when the subscription changed
  assert.deepEqual(seen, [2]);
  assert.equal(probe.reflectionMap?.sequence, 2);
  probe.close();
});

test("subscribes, and gives the estimates that are its own", () => {
  const { probe, socket, sequences } = open({ maxLights: 8 }, "https://probe:1/#token=secret");
  assert.deepEqual(socket().protocols, ["lightprobe.v1", "token.secret"]);
  assert.ok(!socket().url.includes("secret"));
  socket().open();
  socket().hello();
  assert.equal(socket().sent[0]!.maxLights, 8);
  socket().estimate(1, 0); // the default subscription's
  socket().estimate(2);
  assert.deepEqual(sequences, [2]);
  assert.equal(probe.notOurs, 1);
  probe.subscribe({ shOrder: 4 });
  assert.deepEqual([socket().sent[1]!.shOrder, socket().sent[1]!.maxLights, socket().sent[1]!.number], [4, 8, 2]);
  socket().estimate(3, 1);
  socket().estimate(4, 2);
  assert.deepEqual(sequences, [2, 4]);
  probe.close();
});

test("an estimate that has outlived its time to live is none", async () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello();
  socket().estimate(1, 1, 60000, 20);
  assert.equal(probe.latest()?.sequence, 1);
  assert.ok(probe.ageMs()! >= 20);
  socket().estimate(2, 1, 1);
  await until(() => probe.latest() === undefined);
  probe.close();
});

test("connects again with a new subscription, and forgets the clock of another boot", async () => {
  const { probe, socket, sequences } = open();
  socket().open();
  socket().hello(1);
  socket().estimate(1);
  const states: string[] = [];
  probe.on("state", (state) => states.push(state));
  socket().close();
  assert.match(probe.lastError!, /closed the connection/);
  await until(() => Scripted.all.length === 2);
  socket().open();
  socket().hello(2);
  socket().estimate(1);
  assert.deepEqual(sequences, [1, 1]);
  assert.deepEqual(states, ["waiting", "connecting", "open"]);
  assert.equal(probe.lastError, undefined);
  probe.close();
});

test("the probe's reason is kept", () => {
  const { probe, socket } = open();
  socket().open();
  socket().say({ case: "error", value: create(pb.ErrorSchema, { code: -87, text: "the token is missing" }) });
  socket().close();
  assert.match(probe.lastError!, /the token is missing/);
  probe.close();
});

test("nonsense ends the connection, and it is tried again", async () => {
  for (const nonsense of ["text", Uint8Array.of(255, 255).buffer]) {
    const { probe, socket } = open();
    socket().open();
    socket().hello();
    socket().onmessage!({ data: nonsense });
    assert.equal(probe.state, "waiting");
    assert.match(probe.lastError!, /is this a lightprobe\?/);
    await until(() => Scripted.all.length === 2);
    probe.close();
  }
});

test("another major version is final", () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello(1, 2);
  assert.equal(probe.state, "closed");
  assert.match(probe.lastError!, /speaks protocol 2/);
});

test("after close nothing more happens", async () => {
  const { probe, socket, sequences } = open();
  const first = socket();
  first.open();
  first.hello();
  probe.close();
  first.estimate(1);
  await new Promise((done) => setTimeout(done, 200));
  assert.deepEqual([sequences.length, Scripted.all.length, probe.state], [0, 1, "closed"]);
});

test("poses go out with pings of the same clock, which say when their answers came", async () => {
  const { probe, socket } = open();
  assert.equal(probe.sendPose([0, 0, 0, 1]), false, "not connected");
  socket().open();
  socket().hello();
  assert.equal(socket().pings.length, 0, "nobody needs our clock yet");
  assert.equal(probe.sendPose([0, 0.6, 0, 0.8], 5000.25, 0.5), true);
  assert.equal(socket().poses[0]!.timeNs, 5_000_250_000n);
  assert.ok(Math.abs(socket().poses[0]!.orientation[1]! - 0.6) < 1e-6);
  assert.equal(socket().pings[0]!.pongTimeNs, undefined);
  socket().say({ case: "pong", value: create(pb.PongSchema, { pingTimeNs: socket().pings[0]!.timeNs }) });
  await until(() => socket().pings.length === 2);
  const [first, second] = socket().pings as [pb.Ping, pb.Ping];
  assert.ok(second.pongTimeNs! >= first.timeNs && second.pongTimeNs! <= second.timeNs);
  for (const wrong of [[0, 0, 0], [0, 0, 0, 2], [0, 0, 0, NaN]]) assert.throws(() => probe.sendPose(wrong), RangeError);
  assert.equal(socket().poses[0]!.position.length, 0, "nobody says where it is");
  assert.equal(probe.sendPose([0, 0, 0, 1], 5001, undefined, { positionM: [0.25, 1.5, -2], sigmaM: 0.0078125 }), true);
  assert.deepEqual([socket().poses[1]!.position, socket().poses[1]!.positionSigmaM], [[0.25, 1.5, -2], 0.0078125]);
  for (const positionM of [[0, 0], [0, 0, NaN]]) assert.throws(() => probe.sendPose([0, 0, 0, 1], 5002, 1, { positionM }), RangeError);
  assert.throws(() => probe.sendPose([0, 0, 0, 1], 5002, 1, { positionM: [0, 0, 0], sigmaM: 0 }), RangeError);
  probe.close();
});

test("an older probe gets no poses", () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello(1, 1, 2);
  assert.equal(probe.sendPose([0, 0, 0, 1]), false);
  assert.equal(socket().poses.length + socket().pings.length, 0);
  probe.close();
});

/** A page whose main thread is busy, so that nothing that comes is read. */
const pause = (ms: number): void => { for (const until = performance.now() + ms; performance.now() < until;); };

test("after a pause that is longer than the time to live, what came meanwhile is read before light counts as old", async () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello();
  socket().estimate(1, 1, 500);
  pause(700);
  assert.equal(probe.latest()?.sequence, 1, "the first frame after the pause is dark");
  assert.ok(probe.ageMs()! >= 700, "the age itself is told as it is");
  setTimeout(() => socket().estimate(2, 1, 500, 600, 0)); // it waited in the queue for 600 ms
  await until(() => probe.latest()?.sequence === 2 || probe.latest() === undefined);
  assert.equal(probe.latest()?.sequence, 2);
  await until(() => probe.latest() === undefined); // nothing came: it is old all the same
  probe.close();
});

test("what was too old when it was sent is old", () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello();
  socket().estimate(1, 1, 500, 400);
  assert.equal(probe.latest()?.sequence, 1);
  socket().estimate(2, 1, 500, 600);
  assert.equal(probe.latest(), undefined);
  probe.close();
});

test("light ages on after the client was closed", async () => {
  const { probe, socket } = open();
  socket().open();
  socket().hello();
  socket().estimate(1, 1, 300);
  probe.close();
  assert.equal(probe.latest()?.sequence, 1);
  await until(() => probe.latest() === undefined);
});

test("a pause is no silence of the probe", async () => {
  const { probe, socket } = open({ healthPeriodMs: 100 });
  socket().open();
  socket().hello();
  const first = socket();
  pause(5500);
  setTimeout(() => first.estimate(1)); // it waited in the queue
  await new Promise((done) => setTimeout(done, 120));
  assert.equal(probe.state, "open", probe.lastError);
  assert.equal(Scripted.all.length, 1);
  probe.close();
});

test("an address that the browser does not let a page open: an error, and nothing that goes on", () => {
  class Refusing { constructor() { throw new DOMException("an insecure WebSocket in a page of https:", "SecurityError"); } }
  assert.throws(() => new Probe("ws://probe:1/", { WebSocket: Refusing as unknown as typeof WebSocket }), { name: "SecurityError" });
  assert.deepEqual((process as unknown as { getActiveResourcesInfo(): string[] }).getActiveResourcesInfo().filter((kind) => kind === "Timeout"), []);
});
