// SPDX-License-Identifier: Apache-2.0
/** Between the bytes of lightprobe.v1 and typed values. Nothing that comes is trusted. */

import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import * as pb from "./gen/lightprobe_pb.js";
import { broken } from "./ranges.js";
import { decodeRgb9e5, type ReflectionMap } from "./reflection.js";
import type { Drawn, Estimate, Health, Hello, Light, Pong, Refusal, Room, SphericalHarmonics, Vec3 } from "./estimate.js";

export const PROTOCOL_MAJOR = 1;
/** From this minor version on, estimates carry the number of the subscription that they answer. */
export const MINOR_WITH_NUMBERS = 1;
/** From this one on, the probe answers pings and takes poses. */
export const MINOR_WITH_PINGS = 3;

/** Code of a Refusal in place of a Hello: the token is missing or wrong (EACCES). */
export const TOKEN_REFUSED = -13;

/** Bytes that are no message of lightprobe.v1. */
export class WireError extends Error {}

export type Message =
  | { kind: "hello"; hello: Hello }
  | { kind: "estimate"; estimate: Estimate }
  | { kind: "health"; health: Health }
  | { kind: "error"; error: Refusal }
  | { kind: "pong"; pong: Pong }
  | { kind: "reflectionMap"; reflectionMap: ReflectionMap };

/** What a client wants; absent means the probe's default. */
export interface Subscription {
  /** Most estimates a second; 0: every one. */
  rateHz: number;
  /** 0…4 */
  shOrder: number;
  /** 0…8 */
  maxLights: number;
  kind: "AMBIENT" | "TOTAL";
  /** Use the smallest model with a predicted error below this share; 0: the largest. */
  tolerance: number;
  smoothing: "SMOOTHED" | "RAW";
  /** 0: no health messages. */
  healthPeriodMs: number;
  /** While nothing changes by more than the tolerance (at least 0.004), estimates come this far apart, and last so much longer; what is new
   * comes at once. Up to 60000; 0: all come. */
  quietMs: number;
  /** WORLD: of the app that sends poses, where it is known; see Estimate.frame. */
  frame: "PROBE" | "WORLD";
  /** One more directional light, KEY, for what the listed lights leave. */
  keyLight: boolean;
  /** Windows, soft boxes and the like are listed, too, one ellipse each. */
  areaLights: boolean;
  /** Do not list mirror images of lamps; their light stays in the SH. */
  leaveOutReflections: boolean;
  /** What metal and glass mirror; undefined: none. The probe sends it only if Hello.maxReflectionMapSize is not 0. */
  reflectionMap: ReflectionMapWish | undefined;
  /** What the app draws, and the most error of each (0.02: 2 %). Then the probe chooses the least that suffices, and `shOrder`, `maxLights` and
   * `reflectionMap` are no wishes any more: they are not sent where they are the defaults, and upper bounds where they are not. */
  draws?: Drawn | undefined;
}

const THINGS = ["diffuse", "shadows", "glossy", "mirrors"] as const;

/** What is not as exact as was asked, or not known to be. */
export const unmet = (draws: Drawn, drawn: Drawn): (keyof Drawn)[] =>
  THINGS.filter((thing) => draws[thing] !== undefined && !((drawn[thing] ?? Infinity) <= draws[thing]));

export interface ReflectionMapWish {
  /** Texels along an edge; the probe may have fewer. */
  size: 16 | 32 | 64;
  /** Most maps a second, up to 30; 0: 5. */
  rateHz?: number;
  /** Default TOTAL: a mirror shows the lamps. AMBIENT beside lights that shine by themselves. */
  kind?: "AMBIENT" | "TOTAL";
}

export const DEFAULT_SUBSCRIPTION: Subscription = {
  rateHz: 0, shOrder: 2, maxLights: 4, kind: "AMBIENT", tolerance: 0, smoothing: "SMOOTHED", healthPeriodMs: 1000, quietMs: 0,
  frame: "PROBE", keyLight: false, areaLights: false,
  leaveOutReflections: false, reflectionMap: undefined,
};

const kindOf = (kind: "AMBIENT" | "TOTAL"): pb.SphericalHarmonics_Kind => (kind === "TOTAL" ? pb.SphericalHarmonics_Kind.TOTAL : pb.SphericalHarmonics_Kind.AMBIENT);

const permilleOf = (draws: Drawn): Record<string, number> =>
  Object.fromEntries(THINGS.flatMap((thing) => (draws[thing] === undefined ? [] : [[`${thing}Permille`, Math.round(1000 * draws[thing])]])));

function drawnOf(m: pb.Drawn): Drawn {
  const drawn: Drawn = {};
  for (const thing of THINGS) {
    const permille = m[`${thing}Permille`];
    if (permille !== undefined) drawn[thing] = permille / 1000;
  }
  return drawn;
}

function need(value: boolean, what: string): void {
  if (!value) throw new RangeError(`subscription: ${what}`);
}

/** A request for these values; RangeError for one that no probe could serve. */
export function encodeSubscription(wish: Subscription, number: number): Uint8Array<ArrayBuffer> {
  need(wish.rateHz >= 0 && wish.rateHz <= 1000, `rateHz ${wish.rateHz}: expected 0…1000`);
  need(Number.isInteger(wish.shOrder) && wish.shOrder >= 0 && wish.shOrder <= 4, `shOrder ${wish.shOrder}: expected 0…4`);
  need(Number.isInteger(wish.maxLights) && wish.maxLights >= 0 && wish.maxLights <= 8, `maxLights ${wish.maxLights}: expected 0…8`);
  need(wish.tolerance >= 0 && wish.tolerance <= 1, `tolerance ${wish.tolerance}: expected 0…1`);
  need(Number.isInteger(wish.healthPeriodMs) && wish.healthPeriodMs >= 0, `healthPeriodMs ${wish.healthPeriodMs}: expected 0 or more`);
  need(Number.isInteger(wish.quietMs) && wish.quietMs >= 0 && wish.quietMs <= 60000, `quietMs ${wish.quietMs}: expected 0…60000`);
  const map = wish.reflectionMap;
  need(!map || [16, 32, 64].includes(map.size), `reflectionMap.size ${map?.size}: expected 16, 32 or 64`);
  need(!map?.rateHz || (map.rateHz > 0 && map.rateHz <= 30), `reflectionMap.rateHz ${map?.rateHz}: expected 0…30`);
  const { draws } = wish;
  for (const thing of THINGS) need(!draws || draws[thing] === undefined || (draws[thing] >= 0.001 && draws[thing] <= 1), `draws.${thing} ${draws?.[thing]}: expected 0.001…1`);
  const bound = (value: number, byDefault: number): number | undefined => (draws && value === byDefault ? undefined : value);
  return new Uint8Array(toBinary(pb.FromClientSchema, create(pb.FromClientSchema, {
    message: {
      case: "subscribe",
      value: {
        rateHz: wish.rateHz,
        shOrder: bound(wish.shOrder, DEFAULT_SUBSCRIPTION.shOrder),
        maxLights: bound(wish.maxLights, DEFAULT_SUBSCRIPTION.maxLights),
        kind: kindOf(wish.kind),
        tolerancePermille: Math.round(1000 * wish.tolerance),
        smoothing: wish.smoothing === "RAW" ? pb.Subscription_Smoothing.RAW : pb.Subscription_Smoothing.SMOOTHED,
        healthPeriodMs: wish.healthPeriodMs,
        quietMs: wish.quietMs,
        keyLight: wish.keyLight,
        areaLights: wish.areaLights,
        leaveOutReflections: wish.leaveOutReflections,
        ...(map ? { reflectionMap: { size: map.size, rateHz: map.rateHz ?? 0, kind: kindOf(map.kind ?? "TOTAL") } } : {}),
        ...(draws ? { draws: permilleOf(draws) } : {}),
        number,
        frame: wish.frame === "WORLD" ? pb.Estimate_Frame.WORLD : pb.Estimate_Frame.PROBE,
      },
    },
  })));
}

const nanoseconds = (ms: number): bigint => BigInt(Math.round(ms * 1e6));

/** Where a head is: x, y, z in metres, and 1 sigma along each axis (by default 0.005). */
export interface HeadPlace {
  positionM: readonly number[];
  sigmaM?: number;
}

function checkPlace({ positionM, sigmaM }: HeadPlace): void {
  if (positionM.length !== 3 || !positionM.every(Number.isFinite)) throw new RangeError(`pose: ${String(positionM)}: expected x, y, z in metres`);
  if (sigmaM !== undefined && !(sigmaM > 0 && sigmaM < Infinity)) throw new RangeError(`pose: sigmaM ${sigmaM}: expected metres above 0`);
}

/** How the head is turned at a time of performance.now(), and where it is; RangeError for what is no unit quaternion, or no place. */
export function encodePose(xyzw: readonly number[], timeMs: number, sigmaDeg?: number, place?: HeadPlace): Uint8Array<ArrayBuffer> {
  const square = xyzw.reduce((sum, value) => sum + value * value, 0);
  if (xyzw.length !== 4 || !(Math.abs(square - 1) < 0.02)) throw new RangeError(`pose: ${String(xyzw)}: expected a unit quaternion x, y, z, w`);
  if (sigmaDeg !== undefined && !(sigmaDeg > 0 && sigmaDeg < Infinity)) throw new RangeError(`pose: sigmaDeg ${sigmaDeg}: expected degrees above 0`);
  if (place) checkPlace(place);
  const value = {
    timeNs: nanoseconds(timeMs),
    orientation: [...xyzw],
    ...(sigmaDeg === undefined ? {} : { sigmaDeg }),
    ...(place ? { position: [...place.positionM] } : {}),
    ...(place?.sigmaM === undefined ? {} : { positionSigmaM: place.sigmaM }),
  };
  return new Uint8Array(toBinary(pb.FromClientSchema, create(pb.FromClientSchema, { message: { case: "pose", value } })));
}

/** `pongTimeMs`: when the answer to the ping before came, if it has. */
export function encodePing(timeMs: number, pongTimeMs?: number): Uint8Array<ArrayBuffer> {
  const value = { timeNs: nanoseconds(timeMs), ...(pongTimeMs === undefined ? {} : { pongTimeNs: nanoseconds(pongTimeMs) }) };
  return new Uint8Array(toBinary(pb.FromClientSchema, create(pb.FromClientSchema, { message: { case: "ping", value } })));
}

/** One message; undefined when it is of a kind newer than this client. WireError when it is none. */
export function decode(data: Uint8Array): Message | undefined {
  let message: pb.FromProbe["message"];
  try {
    ({ message } = fromBinary(pb.FromProbeSchema, data));
  } catch (error) {
    throw new WireError(`no FromProbe message: ${String(error)}`);
  }
  const refusal = message.value && broken(message.value);
  if (refusal) throw new WireError(refusal);
  switch (message.case) {
    case "hello": return { kind: "hello", hello: message.value };
    case "estimate": return { kind: "estimate", estimate: estimateOf(message.value) };
    case "health": return { kind: "health", health: healthOf(message.value) };
    case "pong": return { kind: "pong", pong: pongOf(message.value) };
    case "reflectionMap": return { kind: "reflectionMap", reflectionMap: reflectionMapOf(message.value) };
    case "error": return { kind: "error", error: { code: message.value.code, text: message.value.text } };
    default: return undefined;
  }
}

/** Of a vector whose length is nearly 1, the one whose length is. */
function unit<T>(values: number[]): T {
  const length = Math.hypot(...values);
  return values.map((value) => value / length) as T;
}

function lightOf(m: pb.Light): Light {
  return {
    id: m.id,
    direction: unit(m.direction),
    irradiance: m.irradiance as unknown as Vec3,
    angularRadiusDeg: m.angularRadiusDeg,
    directionSigmaDeg: m.directionSigmaDeg,
    irradianceSigma: m.irradianceSigmaPermille === undefined ? undefined : m.irradianceSigmaPermille / 1000,
    colourSigma: m.colourSigmaPermille === undefined ? undefined : m.colourSigmaPermille / 1000,
    shadowStrength: m.shadowStrengthPermille === undefined ? undefined : m.shadowStrengthPermille / 1000,
    flags: m.flags,
    distanceM: m.distanceM,
    distanceSigma: m.distanceSigmaPermille === undefined ? undefined : m.distanceSigmaPermille / 1000,
    nearestM: m.nearestM,
    halfAngleDeg: m.halfAngleDeg.length ? (m.halfAngleDeg as [number, number]) : undefined,
    axis: m.axis.length ? unit<Vec3>(m.axis) : undefined,
    dolp: m.dolpPercent === undefined ? undefined : m.dolpPercent / 100,
    dolpSigma: m.dolpSigmaPermille === undefined ? undefined : m.dolpSigmaPermille / 1000,
    aolpDeg: m.aolpDeg,
    aolpSigmaDeg: m.aolpSigmaDeg,
    reflection: m.reflectionPercent === undefined ? undefined : m.reflectionPercent / 100,
  };
}

const kindName = (kind: pb.SphericalHarmonics_Kind): "AMBIENT" | "TOTAL" => (kind === pb.SphericalHarmonics_Kind.TOTAL ? "TOTAL" : "AMBIENT");

const shOf = (m: pb.SphericalHarmonics): SphericalHarmonics => ({ kind: kindName(m.kind), order: m.order, coefficients: m.coefficients });

function estimateOf(m: pb.Estimate): Estimate {
  return {
    sequence: m.sequence,
    bootId: m.bootId,
    captureTimeUnixMs: Number(m.captureTimeUnixNs) / 1e6,
    sendDelayMs: m.sendDelayUs / 1000,
    ttlMs: m.ttlMs,
    flags: m.flags,
    lights: m.lights.map(lightOf),
    key: m.key && lightOf(m.key),
    sh: shOf(m.sh!),
    predictedError: m.predictedErrorPermille === undefined ? undefined : m.predictedErrorPermille / 1000,
    exposureUs: m.exposureUs,
    exposureCount: m.exposureCount,
    cdM2PerUnit: m.cdM2PerUnit,
    cdM2PerUnitSigma: m.cdM2PerUnitSigmaPermille === undefined ? undefined : m.cdM2PerUnitSigmaPermille / 1000,
    scaleSigma: m.scaleSigmaPermille === undefined ? undefined : m.scaleSigmaPermille / 1000,
    wheelDeg: m.wheelDeg,
    subscription: m.subscription,
    frame: m.frame === pb.Estimate_Frame.WORLD ? "WORLD" : "PROBE",
    orientation: m.orientation.length ? unit<[number, number, number, number]>(m.orientation) : undefined,
    orientationSigmaDeg: m.orientationSigmaDeg,
    positionM: m.position.length ? (m.position as [number, number, number]) : undefined,
    room: m.room && roomOf(m.room),
    drawn: m.drawn && drawnOf(m.drawn),
  };
}

function roomOf(m: pb.Room): Room {
  return {
    wallsM: m.wallsM, wallsSigmaM: m.wallsSigmaM, orientation: unit<[number, number, number, number]>(m.orientation), errorPerM: m.errorPermillePerM / 1000,
  };
}

function reflectionMapOf(m: pb.ReflectionMap): ReflectionMap {
  return {
    sequence: m.sequence,
    bootId: m.bootId,
    captureTimeUnixMs: Number(m.captureTimeUnixNs) / 1e6,
    subscription: m.subscription,
    kind: kindName(m.kind),
    size: m.size,
    faces: decodeRgb9e5(m.texels, m.size, m.scale),
    orientation: m.orientation.length ? unit<[number, number, number, number]>(m.orientation) : undefined,
    drawn: m.drawn && drawnOf(m.drawn),
  };
}

function pongOf(m: pb.Pong): Pong {
  return { pingTimeMs: Number(m.pingTimeNs) / 1e6, receivedUnixMs: Number(m.receivedUnixNs) / 1e6, sentUnixMs: Number(m.sentUnixNs) / 1e6 };
}

function healthOf(m: pb.Health): Health {
  return {
    uptimeMs: Number(m.uptimeMs),
    sourceState: pb.Health_SourceState[m.sourceState] ?? "UNKNOWN",
    framesReceived: Number(m.framesReceived),
    framesDropped: Number(m.framesDropped),
    framesRejected: Number(m.framesRejected),
    estimates: Number(m.estimates),
    estimatesPerS: m.estimatesPerS,
    latencyP50Us: m.latencyP50Us,
    latencyP99Us: m.latencyP99Us,
    clients: m.clients,
    packetsSuperseded: Number(m.packetsSuperseded),
    cpuPercent: m.cpuPercent,
    rssKib: m.rssKib,
    preset: m.preset,
    faults: m.faults.map(({ id, text }) => ({ id, text })),
  };
}
