// SPDX-License-Identifier: Apache-2.0
import assert from "node:assert/strict";
import { test } from "node:test";
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import * as pb from "../src/gen/lightprobe_pb.js";
import { DEFAULT_SUBSCRIPTION, WireError, decode, encodeSubscription, unmet } from "../src/wire.js";
import { flagNames } from "../src/index.js";
import { bytes, expected, names } from "./golden.js";

test("flags are named as in the schema, and one that is not known by its bit", () => {
  assert.deepEqual(flagNames(pb.EstimateFlag.CLIPPED | pb.EstimateFlag.FILM_TURNED | (1 << 30)), ["CLIPPED", "FILM_TURNED", "BIT_30"]);
});

/** The name that JavaScript has for a name of the schema. */
const camel = (snake: string): string => snake.replace(/_(\w)/g, (_, letter: string) => letter.toUpperCase());

/** "estimate.lights[0].direction[2]" in C's names, of a decoded message; a message's name alone: that it is there. */
function read(message: unknown, path: string): unknown {
  if (!path.includes(".")) return message !== undefined;
  let value = message as Record<string, unknown>;
  for (const step of path.split(".").slice(1)) {
    const [, snake, index] = /^(\w+?)(?:\[(\d+)\])?$/.exec(step)!;
    const name = camel(snake!);
    if (name.endsWith("Count") && !(name in value)) return ((value[name.slice(0, -5)] as unknown[]) ?? []).length;
    let next = value[name];
    if (index !== undefined) next = (next as unknown[])[Number(index)];
    if (next === undefined) return null;
    value = next as Record<string, unknown>;
  }
  if (value instanceof Uint8Array) return `0x${Buffer.from(value).toString("hex")}`;
  return typeof value === "bigint" ? Number(value) : value;
}

const numeric = (value: unknown): unknown => (Number.isNaN(value) ? "NaN" : value);

for (const name of names) {
  test(`golden bytes decode: ${name}`, () => {
    const schema = name.startsWith("from_client") ? pb.FromClientSchema : pb.FromProbeSchema;
    const message = fromBinary<typeof schema>(schema as never, bytes(name)) as unknown as { message: { case: string; value: unknown } };
    const values = expected[name]!;
    assert.equal(camel(Object.keys(values)[0]!.split(".")[0]!), message.message.case);
    for (const [path, value] of Object.entries(values)) {
      const got = numeric(read(message.message.value, path));
      if (typeof value === "number" && typeof got === "number") assert.ok(Math.abs(got - value) <= Math.abs(value) * 1e-15, `${path}: ${got}, expected ${value}`);
      else assert.deepEqual(got, value, path);
    }
  });
}

test("an estimate in units that their names say", () => {
  const message = decode(bytes("estimate_full.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  const values = expected["estimate_full.bin"]!;
  const { estimate } = message;
  assert.equal(estimate.lights.length, values["estimate.lights_count"]);
  assert.ok(Math.abs(Math.hypot(...estimate.lights[0]!.direction) - 1) < 1e-12);
  assert.equal(estimate.sh.coefficients.length, values["estimate.sh.coefficients_count"]);
  assert.equal(estimate.ttlMs, values["estimate.ttl_ms"]);
  assert.equal(estimate.sendDelayMs, (values["estimate.send_delay_us"] as number) / 1000);
});

test("what is not known is undefined, never zero", () => {
  const message = decode(bytes("estimate_unknown.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  for (const name of ["predictedError", "exposureUs", "cdM2PerUnit", "wheelDeg"] as const) assert.equal(message.estimate[name], undefined, name);
});

test("an estimate in the app's world says so, with its orientation", () => {
  const message = decode(bytes("estimate_world.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  assert.equal(message.estimate.frame, "WORLD");
  assert.ok(Math.abs(message.estimate.orientation![3] - 0.8) < 1e-6);
  assert.equal(message.estimate.orientationSigmaDeg, 0.25);
});

test("KEY and the ellipse of an area light", () => {
  const message = decode(bytes("estimate_key.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  const { estimate } = message;
  assert.equal(estimate.key?.id, 0);
  assert.deepEqual(estimate.key.irradiance, [1.5, 1.25, 1]);
  assert.deepEqual(estimate.lights[0]!.halfAngleDeg, [30.5, 8.25]);
  assert.equal(estimate.lights[0]!.axis!.length, 3);
  assert.equal(estimate.key.axis, undefined);
});

test("how a lamp is polarized, with sigmas; an older probe sends none", () => {
  for (const [file, sigmas] of [["estimate_polarization_sigma.bin", [0.013, 0.75]], ["estimate_polarization.bin", [undefined, undefined]]] as const) {
    const message = decode(bytes(file));
    assert.equal(message?.kind, "estimate");
    if (message?.kind !== "estimate") return;
    const [light] = message.estimate.lights;
    assert.deepEqual([light!.dolp, light!.aolpDeg, light!.reflection], [0.87, 176.5, 0.99]);
    assert.deepEqual([light!.dolpSigma, light!.aolpSigmaDeg], sigmas);
  }
});

test("how dark a lamp's shadow on a table is; an older probe does not say", () => {
  for (const [file, strength] of [["estimate_shadow_strength.bin", 0.625], ["estimate_colour_sigma.bin", undefined]] as const) {
    const message = decode(bytes(file));
    assert.equal(message?.kind, "estimate");
    if (message?.kind !== "estimate") return;
    assert.equal(message.estimate.lights[0]!.shadowStrength, strength);
  }
});

test("how far away a lamp is, and how sure that is", () => {
  const message = decode(bytes("estimate_distance.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  const { distanceM, distanceSigma, nearestM } = message.estimate.lights[0]!;
  assert.deepEqual([distanceM, distanceSigma, nearestM], [2.75, 0.012, undefined]);
});

test("what is drawn: asked in permille, and told as shares", () => {
  const message = decode(bytes("estimate_drawn.bin"));
  assert.equal(message?.kind, "estimate");
  if (message?.kind !== "estimate") return;
  assert.deepEqual(message.estimate.drawn, { diffuse: 0.021, shadows: 0, mirrors: 1000 });
  assert.deepEqual(unmet({ diffuse: 0.02, shadows: 0.01, glossy: 0.1 }, message.estimate.drawn!), ["diffuse", "glossy"]);
  const map = decode(bytes("reflection_map_drawn.bin"));
  assert.deepEqual(map?.kind === "reflectionMap" && map.reflectionMap.drawn, { glossy: 0.003, mirrors: 0.109 });
  const draws = { diffuse: 0.02, shadows: 0.05, mirrors: 0.3 };
  const sent = fromBinary(pb.FromClientSchema, encodeSubscription({ ...DEFAULT_SUBSCRIPTION, draws, maxLights: 1 }, 9)).message;
  const frozen = fromBinary(pb.FromClientSchema, bytes("from_client_draws.bin")).message;
  assert.ok(sent.case === "subscribe" && frozen.case === "subscribe");
  assert.deepEqual(sent.value.draws, frozen.value.draws);
  assert.deepEqual([sent.value.shOrder, sent.value.maxLights], [undefined, 1]);
  for (const wrong of [{ diffuse: 0 }, { mirrors: 2 }, { glossy: NaN }])
    assert.throws(() => encodeSubscription({ ...DEFAULT_SUBSCRIPTION, draws: wrong }, 1), RangeError, JSON.stringify(wrong));
});

test("garbage is a WireError, and a message of the future is skipped", () => {
  assert.throws(() => decode(Uint8Array.of(0xff, 0xff, 0xff)), WireError);
  assert.equal(decode(Uint8Array.of(0x7a, 2, 104, 105)), undefined);
  for (let seed = 1; seed < 500; seed++) {
    const data = bytes("estimate_full.bin").slice();
    for (let k = 0; k < 4; k++) data[(seed * 7919 + k * 104729) % data.length] = (seed * 31 + k * 17) & 0xff;
    try {
      decode(data);
    } catch (error) {
      assert.ok(error instanceof WireError, String(error));
    }
  }
});

test("numbers that make no sense are refused", () => {
  const bad = (estimate: object): Uint8Array => toBinary(pb.FromProbeSchema, create(pb.FromProbeSchema, { message: { case: "estimate", value: estimate as never } }));
  const sh = { kind: 1, order: 0, coefficients: [1, 1, 1] };
  assert.equal(decode(bad({ sh }))?.kind, "estimate");
  for (const estimate of [
    {}, { sh: { ...sh, order: 1 } }, { sh: { ...sh, coefficients: [1, NaN, 1] } }, { sh: { ...sh, kind: 0 } }, { sh: { ...sh, basis: 7 } },
    { sh, lights: [{ direction: [0, 2, 0], irradiance: [1, 1, 1] }] }, { sh, lights: [{ direction: [0, 1, 0], irradiance: [1, Infinity, 1] }] },
  ]) assert.throws(() => decode(bad(estimate)), WireError, JSON.stringify(estimate));
});

test("a subscription is checked before anything is sent", () => {
  for (const wrong of [{ rateHz: -1 }, { rateHz: NaN }, { shOrder: 5 }, { shOrder: 1.5 }, { maxLights: 9 }, { tolerance: 2 }, { healthPeriodMs: -1 }, { quietMs: -1 }, { quietMs: 60001 }])
    assert.throws(() => encodeSubscription({ ...DEFAULT_SUBSCRIPTION, ...wrong }, 1), RangeError, JSON.stringify(wrong));
  const sent = fromBinary(pb.FromClientSchema, encodeSubscription({ ...DEFAULT_SUBSCRIPTION, shOrder: 0, maxLights: 0 }, 7)).message;
  assert.equal(sent.case, "subscribe");
  if (sent.case === "subscribe") assert.deepEqual([sent.value.shOrder, sent.value.maxLights, sent.value.number], [0, 0, 7]);
});

test("a reflection map: texels by their definition, faces in their order", () => {
  const message = decode(bytes("reflection_map.bin"));
  assert.equal(message?.kind, "reflectionMap");
  if (message?.kind !== "reflectionMap") return;
  const { reflectionMap: map } = message;
  assert.deepEqual([map.size, map.kind, map.sequence, map.subscription, map.faces.length], [16, "TOTAL", 12, 300, 6]);
  assert.deepEqual([...map.faces[0]!.subarray(0, 6)], [0.25, 0.125, 0.0625, 0, 0, 0]); // scale 0.25 × (1, 1/2, 1/4)
  assert.equal(map.faces[5]!.at(-1), 0.25 * 511 * 2 ** 7);
  assert.deepEqual(map.orientation, [0.5, -0.5, 0.5, 0.5]);
});

test("a reflection map that makes no sense is refused", () => {
  const good = { kind: 2, size: 16, scale: 1, texels: new Uint8Array(24 * 256) };
  const encode = (value: object): Uint8Array => toBinary(pb.FromProbeSchema, create(pb.FromProbeSchema, { message: { case: "reflectionMap", value: create(pb.ReflectionMapSchema, value as never) } }));
  assert.equal(decode(encode(good))?.kind, "reflectionMap");
  for (const bad of [{ size: 17 }, { size: 32 }, { texels: new Uint8Array(4) }, { scale: 0 }, { scale: NaN }, { scale: Infinity }, { kind: 0 }])
    assert.throws(() => decode(encode({ ...good, ...bad })), WireError, JSON.stringify(bad));
});

test("wishes for reflection maps are checked", () => {
  for (const reflectionMap of [{ size: 8 }, { size: 32, rateHz: 31 }, { size: 32, rateHz: -1 }])
    assert.throws(() => encodeSubscription({ ...DEFAULT_SUBSCRIPTION, reflectionMap: reflectionMap as never }, 1), RangeError);
  const request = fromBinary(pb.FromClientSchema, encodeSubscription({ ...DEFAULT_SUBSCRIPTION, reflectionMap: { size: 16 } }, 1));
  assert.equal(request.message.case === "subscribe" && request.message.value.reflectionMap?.kind, pb.SphericalHarmonics_Kind.TOTAL);
});
