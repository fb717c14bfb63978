// SPDX-License-Identifier: Apache-2.0
/** A probe's client: connects, asks, stays. The newest estimate wins; what is too old is none. */

import { Drained } from "./drained.js";
import type { Estimate, Health, Hello } from "./estimate.js";
import type { ReflectionMap } from "./reflection.js";
import { whyUnanswered } from "./unanswered.js";
import { type HeadPlace, DEFAULT_SUBSCRIPTION, MINOR_WITH_NUMBERS, MINOR_WITH_PINGS, PROTOCOL_MAJOR, TOKEN_REFUSED, WireError, decode, encodePing, encodePose, encodeSubscription } from "./wire.js";
import type { Message, Subscription } from "./wire.js";

const PROTOCOL = "lightprobe.v1";
const BACKOFF_FIRST_MS = 100, BACKOFF_LAST_MS = 5000;
/** After a refused token. The daemon forgets a wrong one in a minute; several of an address bar all. */
const TOKEN_BACKOFF_MS = 80_000;
/** A greeting comes at once, health periodically: longer silence is a fault. */
const HELLO_TIMEOUT_MS = 5000, LEAST_PATIENCE_MS = 5000;
/** Of how many messages the fastest tells how far the probe's clock is off. */
const CLOCK_MESSAGES = 32;
/** How often the probe is told our clock, which it needs for poses. */
const PING_PERIOD_MS = 1000;
/** A silence that may end with what is not read yet is judged again after this time. */
const LOOK_AGAIN_MS = 50;

/** connecting: no greeting yet. open: greeted. waiting: until the next attempt. closed: for good. */
export type State = "connecting" | "open" | "waiting" | "closed";

export interface ProbeEvents {
  estimate: Estimate;
  hello: Hello;
  health: Health;
  reflectionMap: ReflectionMap;
  state: State;
}

export interface ProbeOptions extends Partial<Subscription> {
  /** For programs outside of browsers, and for tests. */
  WebSocket?: typeof WebSocket;
}

/** Address of the messages and the token, from `ws:`, `wss:` or the page's own `http:`, `https:`. */
export function parseAddress(address: string): { url: string; token: string | undefined } {
  let url: URL;
  try {
    url = new URL(address);
  } catch {
    throw new TypeError(`${address}: address: expected ws://HOST:PORT/ or wss://HOST:PORT/#token=…`);
  }
  const schemes: Record<string, string> = { "http:": "ws:", "https:": "wss:", "ws:": "ws:", "wss:": "wss:" };
  const scheme = schemes[url.protocol];
  if (["0.0.0.0", "[::]"].includes(url.hostname))
    throw new TypeError(`${url.protocol}//${url.host}/: address: ${url.hostname} stands for all addresses of the probe's machine: take one of them, or its name`);
  if (["mqtt:", "mqtts:"].includes(url.protocol))
    throw new TypeError(`${url.protocol}//${url.host}${url.pathname}: address: this client speaks to the probe and to no MQTT broker: take the probe's own address, ws://HOST:PORT/ (lightprobed --publish=ws:), or Python's client`);
  if (!scheme) throw new TypeError(`${url.protocol}: address: expected ws:, wss:, http: or https:`);
  const token = new URLSearchParams(url.hash.slice(1)).get("token") ?? undefined;
  if (token && scheme !== "wss:")
    throw new TypeError(`${scheme}//${url.host}/: address: ${url.protocol} would send the token in clear: take the address that \`lightprobe pair\` prints, with https: or wss:`);
  return { url: `${scheme}//${url.host}/`, token };
}

/**
 * @example
 * const probe = new Probe("ws://127.0.0.1:7701/", { maxLights: 8 });
 * probe.on("estimate", (estimate) => draw(estimate.lights));
 */
export class Probe {
  state: State = "connecting";
  hello: Hello | undefined;
  health: Health | undefined;
  /** The newest, however old; undefined before the first. */
  reflectionMap: ReflectionMap | undefined;
  /** Why there is nothing, in a sentence; undefined while all is well. */
  lastError: string | undefined;
  /** Estimates that were made for an earlier subscription: dropped. */
  notOurs = 0;
  connections = 0;

  readonly #url: string;
  readonly #token: string | undefined;
  readonly #WebSocket: typeof WebSocket;
  readonly #listeners = new Map<keyof ProbeEvents, Set<(value: never) => void>>();
  #wish: Subscription;
  #number = 1;
  #newest: Estimate | undefined;
  #socket: WebSocket | undefined;
  #backoffMs = BACKOFF_FIRST_MS;
  #retry: ReturnType<typeof setTimeout> | undefined;
  #silence: ReturnType<typeof setTimeout> | undefined;
  readonly #drained = new Drained(now);
  #offsetsMs: number[] = [];
  #pings: ReturnType<typeof setInterval> | undefined;
  #pongMs: number | undefined;
  readonly #wake = (): void => { if (this.state === "waiting" && !document.hidden) this.#connect(); };

  /** Connects at once, in the background; TypeError for an address that is none, a SecurityError for ws: in a page of https:. */
  constructor(address: string, options: ProbeOptions = {}) {
    const { WebSocket: implementation, ...wish } = options;
    ({ url: this.#url, token: this.#token } = parseAddress(address));
    this.#WebSocket = implementation ?? WebSocket;
    this.#wish = { ...DEFAULT_SUBSCRIPTION, ...wish };
    encodeSubscription(this.#wish, this.#number); // what no probe could serve shows here
    this.#connect(); // it throws where a page may not open the address at all (https: and ws:): then nothing is left behind
    if (typeof document !== "undefined") {
      document.addEventListener("visibilitychange", this.#wake);
      window.addEventListener("online", this.#wake);
    }
    this.#drained.start();
  }

  /** Call `listener` with every event of a kind; gives what ends that. What it throws stays uncaught, as of the browser's own events. */
  on<K extends keyof ProbeEvents>(kind: K, listener: (value: ProbeEvents[K]) => void): () => void {
    const set = this.#listeners.get(kind) ?? new Set();
    this.#listeners.set(kind, set);
    set.add(listener as (value: never) => void);
    return () => set.delete(listener as (value: never) => void);
  }

  /**
   * The newest estimate; undefined before the first, and when it has outlived its ttlMs. After a pause of the page, what came
   * meanwhile is read first: until then the one before the pause remains. What was too old when it was sent is so here.
   */
  latest(): Estimate | undefined {
    const newest = this.#newest;
    if (!newest) return undefined;
    const ageMs = Math.max(this.#drained.untilMs - this.#capturedMs(newest), newest.sendDelayMs);
    return newest.ttlMs && ageMs > newest.ttlMs ? undefined : newest;
  }

  /** Milliseconds since the capture of the newest estimate, aged out or not. */
  ageMs(): number | undefined {
    return this.#newest && now() - this.#capturedMs(this.#newest);
  }

  /** When it was captured, by our clock. */
  #capturedMs(estimate: Estimate): number {
    return estimate.captureTimeUnixMs + Math.min(...this.#offsetsMs);
  }

  /** Ask for something else, now and after every reconnection. */
  subscribe(wish: Partial<Subscription>): void {
    const next = { ...this.#wish, ...wish };
    const request = encodeSubscription(next, this.#number + 1);
    this.#wish = next;
    this.#number++;
    if (this.#socket?.readyState === 1) this.#socket.send(request);
  }

  /**
   * Say how the head is turned that the probe sits on: x, y, z, w from the head's frame to your world, at a time of
   * performance.now(). `place`: where it is, too, with which lamps get distances as it moves. The daemon needs
   * --orientation=client. False: not connected, or an older probe.
   */
  sendPose(xyzw: readonly number[], timeMs: number = now(), sigmaDeg?: number, place?: HeadPlace): boolean {
    const pose = encodePose(xyzw, timeMs, sigmaDeg, place);
    if (this.#socket?.readyState !== 1 || !this.#takesPoses()) return false;
    this.#startPings();
    this.#socket.send(pose);
    return true;
  }

  /** End for good. */
  close(): void {
    this.#end("closed");
    if (typeof document !== "undefined") {
      document.removeEventListener("visibilitychange", this.#wake);
      window.removeEventListener("online", this.#wake);
    }
  }

  /** What a listener throws is the app's, not the network's: it is not caught (window.onerror), and nothing here ends for it. */
  #emit<K extends keyof ProbeEvents>(kind: K, value: ProbeEvents[K]): void {
    for (const listener of [...(this.#listeners.get(kind) ?? [])])
      try {
        (listener as (value: ProbeEvents[K]) => void)(value);
      } catch (error) {
        queueMicrotask(() => { throw error; });
      }
  }

  #become(state: State): void {
    if (this.state === state) return;
    this.state = state;
    this.#emit("state", state);
  }

  #takesPoses(): boolean {
    return this.state === "open" && this.hello !== undefined && this.hello.protocolMinor >= MINOR_WITH_PINGS;
  }

  /** From the first pose of a connection on: without poses nobody needs our clock. */
  #startPings(): void {
    if (this.#pings !== undefined) return;
    const ping = (): void => {
      if (this.#socket?.readyState === 1) this.#socket.send(encodePing(now(), this.#pongMs));
      this.#pongMs = undefined;
    };
    this.#pings = setInterval(ping, PING_PERIOD_MS);
    ping();
  }

  #stopPings(): void {
    clearInterval(this.#pings);
    this.#pings = this.#pongMs = undefined;
  }

  #connect(): void {
    clearTimeout(this.#retry);
    this.#become("connecting");
    const protocols = this.#token ? [PROTOCOL, `token.${this.#token}`] : [PROTOCOL];
    const socket = new this.#WebSocket(this.#url, protocols);
    socket.binaryType = "arraybuffer";
    this.#socket = socket;
    let refusal: string | undefined, isTokenRefused = false;
    socket.onopen = () => socket.send(encodeSubscription(this.#wish, this.#number));
    socket.onmessage = ({ data }) => {
      if (socket !== this.#socket) return;
      try {
        if (typeof data === "string") throw new WireError("a text message");
        const message = decode(new Uint8Array(data as ArrayBuffer));
        if (message?.kind === "error") {
          refusal = this.lastError = `${this.#url}: ${message.error.text}`;
          isTokenRefused = this.state !== "open" && message.error.code === TOKEN_REFUSED;
        } else if (message) this.#take(message);
      } catch (error) {
        if (!(error instanceof WireError)) throw error;
        refusal = `${this.#url}: receive: ${error.message}: is this a lightprobe?`;
        socket.close();
      }
    };
    socket.onclose = () => {
      if (socket !== this.#socket) return;
      this.lastError = refusal ?? this.lastError ?? this.#whyClosed();
      if (isTokenRefused) this.#backoffMs = TOKEN_BACKOFF_MS;
      this.#lose();
    };
    this.#expectWithin(HELLO_TIMEOUT_MS);
  }

  #whyClosed(): string {
    if (this.hello) return `${this.#url}: the probe closed the connection`;
    const origin = typeof location === "undefined" ? undefined : location.origin, why = whyUnanswered(this.#url, origin);
    if (origin !== undefined) console.warn(`lightprobe: ${why}`); // beside the browser's own line, which does not say it
    return why;
  }

  #take(message: Exclude<Message, { kind: "error" }>): void {
    if (message.kind === "hello") this.#greet(message.hello);
    else if (!this.hello) throw new WireError("the first message is not a Hello");
    else if (message.kind === "estimate") this.#takeEstimate(message.estimate);
    else if (message.kind === "reflectionMap") this.#takeReflectionMap(message.reflectionMap);
    else if (message.kind === "pong") this.#pongMs = now();
    else {
      this.health = message.health;
      this.#emit("health", message.health);
    }
    const period = this.#wish.healthPeriodMs;
    this.#expectWithin(period ? Math.max(LEAST_PATIENCE_MS, 5 * period) : undefined);
  }

  #greet(hello: Hello): void {
    if (hello.protocolMajor !== PROTOCOL_MAJOR) {
      this.lastError = `${this.#url}: ${hello.software} speaks protocol ${hello.protocolMajor}, this client ${PROTOCOL_MAJOR}: use the client of the probe's version`;
      this.#end("closed");
      return;
    }
    if (this.hello?.bootId !== hello.bootId) this.#offsetsMs = [];
    if (this.state !== "open") this.connections++;
    this.hello = hello;
    this.lastError = undefined;
    this.#backoffMs = BACKOFF_FIRST_MS;
    this.#become("open");
    this.#emit("hello", hello);
  }

  #takeEstimate(estimate: Estimate): void {
    if (this.hello!.protocolMinor >= MINOR_WITH_NUMBERS && estimate.subscription !== this.#number) {
      this.notOurs++;
      return;
    }
    this.#offsetsMs.push(now() - (estimate.captureTimeUnixMs + estimate.sendDelayMs));
    if (this.#offsetsMs.length > CLOCK_MESSAGES) this.#offsetsMs.shift();
    this.#newest = estimate;
    this.#emit("estimate", estimate);
  }

  #takeReflectionMap(map: ReflectionMap): void {
    if (map.subscription !== this.#number) return;
    this.reflectionMap = map;
    this.#emit("reflectionMap", map);
  }

  #expectWithin(ms: number | undefined): void {
    clearTimeout(this.#silence);
    if (ms === undefined) return;
    const dueMs = now() + ms;
    const look = (): void => {
      if (this.#drained.untilMs < dueMs) {
        this.#silence = setTimeout(look, LOOK_AGAIN_MS);
        return;
      }
      this.lastError = `${this.#url}: silent for too long: is the network up?`;
      const socket = this.#socket;
      this.#socket = undefined;
      socket?.close();
      this.#lose();
    };
    this.#silence = setTimeout(look, ms);
  }

  /** Nothing is open; try again later, not all clients at once. */
  #lose(): void {
    if (this.state === "closed") return;
    clearTimeout(this.#silence);
    this.#stopPings();
    this.#socket = undefined;
    this.#become("waiting");
    this.#retry = setTimeout(() => this.#connect(), this.#backoffMs * (0.8 + 0.4 * Math.random()));
    this.#backoffMs = Math.min(2 * this.#backoffMs, BACKOFF_LAST_MS);
  }

  #end(state: State): void {
    this.#drained.stop();
    clearTimeout(this.#retry);
    clearTimeout(this.#silence);
    this.#stopPings();
    const socket = this.#socket;
    this.#socket = undefined;
    this.#become(state);
    socket?.close();
  }
}

/** A clock that nobody sets. */
const now = (): number => performance.now();
