// SPDX-License-Identifier: Apache-2.0
import assert from "node:assert/strict";
import { test } from "node:test";
import { Quaternion, Vector3 } from "three";
import { estimateAt, fallbackEstimate, irradiance, LightFlag, meanIrradiance, sh, type Light, type Vec3 } from "../src/index.js";
import { ProbeLight } from "../src/three.js";
import { lightEstimate } from "../src/webxr.js";
import { decode } from "../src/wire.js";
import { bytes, fallbacks } from "./golden.js";
import { estimate, lamp } from "./lights.js";

const NORMALS: Vec3[] = Array.from({ length: 60 }, (_, i) => {
  const y = 1 - (2 * (i + 0.5)) / 60, radius = Math.sqrt(1 - y * y), turn = i * 2.399963;
  return [radius * Math.cos(turn), y, radius * Math.sin(turn)];
});
const ramp = Array.from({ length: 27 }, (_, i) => Math.sin(3 * i + 1));

test("the basis has the constants of the conventions", () => {
  const [x, y, z] = [0.48, 0.6, 0.64];
  const want = [0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)];
  sh.basis(2, [x, y, z]).forEach((value, i) => assert.ok(Math.abs(value - want[i]!) < 1e-6, `Y${i}`));
});

test("the basis is orthonormal up to order 4", () => {
  const gram = Array.from({ length: 25 }, () => Array<number>(25).fill(0));
  const rows = 40, columns = 80;
  for (let r = 0; r < rows; r++) for (let c = 0; c < columns; c++) {
    const t = (Math.PI * (r + 0.5)) / rows, a = (2 * Math.PI * (c + 0.5)) / columns;
    const Y = sh.basis(4, [Math.sin(t) * Math.cos(a), Math.cos(t), Math.sin(t) * Math.sin(a)]);
    const area = (2 * Math.PI / columns) * (Math.cos((Math.PI * r) / rows) - Math.cos((Math.PI * (r + 1)) / rows));
    for (let i = 0; i < 25; i++) for (let j = 0; j < 25; j++) gram[i]![j]! += Y[i]! * Y[j]! * area;
  }
  for (let i = 0; i < 25; i++) for (let j = 0; j < 25; j++) assert.ok(Math.abs(gram[i]![j]! - (i === j ? 1 : 0)) < 0.01, `${i} ${j} ${gram[i]![j]}`);
});

test("KEY is light of its own, but not in a TOTAL", () => {
  const key = lamp(0, [0, 1, 0], [2, 1, 0.5]);
  const both = { ...estimate([lamp(1, [0, 1, 0])]), key };
  assert.deepEqual(irradiance(both, [0, 1, 0]), [3, 2, 1.5]);
  assert.deepEqual(irradiance({ ...both, sh: { ...both.sh, kind: "TOTAL" } }, [0, 1, 0]), [0, 0, 0]);
  assert.equal(lightEstimate(both)!.primaryLightIntensity.x, 2);
});

test("turned SH are what the turned directions see", () => {
  const turn = new Quaternion().setFromAxisAngle(new Vector3(1, 2, -0.5).normalize(), 1.1);
  const toProbe = (d: Vec3): Vec3 => new Vector3(...d).applyQuaternion(turn).toArray() as unknown as Vec3;
  const turned = sh.rotate(ramp, toProbe);
  for (const n of NORMALS) {
    const seen = sh.radiance(turned, n), want = sh.radiance(ramp, toProbe(n));
    seen.forEach((value, c) => assert.ok(Math.abs(value - want[c]!) < 1e-9));
  }
});

test("WebXR's shape: no light is lost or counted twice, whatever the number of lamps", () => {
  const lamps = [lamp(1, [0, 1, 0], [3, 2, 1]), lamp(2, [0.6, 0.8, 0], [5, 5, 5]), lamp(3, [0, 0.6, -0.8], [1, 2, 3])];
  const whole = estimate(lamps, ramp);
  const shape = lightEstimate(whole);
  assert.deepEqual(shape.primaryLightDirection, { x: 0.6, y: 0.8, z: 0, w: 0 });
  assert.deepEqual(shape.primaryLightIntensity, { x: 5, y: 5, z: 5, w: 1 });
  const all = (source: ArrayLike<number>, lights: Light[]): number[] => {
    const sum = Array.from(source);
    for (const one of lights) sh.addLamp(sum, one.direction, one.irradiance);
    return sum;
  };
  const got = all(shape.sphericalHarmonicsCoefficients, [lamps[1]!]), want = all(ramp, lamps);
  got.forEach((value, i) => assert.ok(Math.abs(value - want[i]!) < 1e-5, `${i}`));
});

test("WebXR's shape without a lamp, and without an estimate", () => {
  for (const shape of [lightEstimate(estimate([], ramp)), lightEstimate(undefined)]) {
    assert.deepEqual(shape.primaryLightDirection, { x: 0, y: 1, z: 0, w: 0 });
    assert.deepEqual(shape.primaryLightIntensity, { x: 0, y: 0, z: 0, w: 1 });
  }
  assert.equal(lightEstimate(undefined).sphericalHarmonicsCoefficients.length, 27);
});

test("one lamp straight up lights what faces up", () => {
  const up = estimate([lamp(1, [0, 1, 0], [2, 2, 2])]);
  assert.deepEqual(irradiance(up, [0, 1, 0]), [2, 2, 2]);
  assert.deepEqual(irradiance(up, [0, -1, 0]), [0, 0, 0]);
  const light = new ProbeLight();
  light.set(up);
  const shown = light.lamps.filter((one) => one.intensity > 0);
  assert.equal(shown.length, 1);
  assert.ok(shown[0]!.position.y > 9.9);
});

test("a mirror image lights things, but casts no shadow", () => {
  const seen = estimate([lamp(1, [0, 1, 0]), { ...lamp(2, [0.6, -0.8, 0]), flags: LightFlag.REFLECTION }]);
  const light = new ProbeLight();
  light.set(seen);
  const shown = light.lamps.filter((one) => one.intensity > 0);
  assert.deepEqual(shown.map((one) => [one.position.y > 0, one.castShadow]), [[true, true], [false, false]]);
  assert.deepEqual(irradiance(seen, [0, -1, 0]).map((value) => Math.round(10 * value)), [8, 8, 8]);
  light.set(estimate([lamp(1, [0, 1, 0]), lamp(2, [0.6, -0.8, 0])])); // it is none after all
  assert.ok(light.lamps.filter((one) => one.intensity > 0).every((one) => one.castShadow));
  const without = new ProbeLight({ castShadow: false });
  without.set(seen);
  assert.ok(without.lamps.every((one) => !one.castShadow));
});

const sum = (light: ProbeLight): number => light.lamps.reduce((total, one) => total + one.intensity, 0);

test("lamps fade, and never jump", () => {
  const light = new ProbeLight({ fadeS: 0.2 });
  light.set(estimate([lamp(1, [0, 1, 0])]));
  let last = sum(light);
  const script = [estimate([]), estimate([lamp(2, [1, 0, 0], [4, 4, 4]), lamp(3, [0, 0, 1])]), estimate([lamp(2, [0, 1, 0], [4, 4, 4])]), undefined];
  let time = 0;
  for (const target of script)
    for (let k = 0; k < 60; k++) {
      light.update(target, (time += 0.01));
      assert.ok(Math.abs(sum(light) - last) < 0.35, `jump at ${time}: ${last} to ${sum(light)}`);
      last = sum(light);
    }
  assert.ok(last < 0.3, "no lamp is lit in the end");
});

test("a lamp keeps its light while it moves, and a new boot's lamp of the same number is another", () => {
  const light = new ProbeLight({ fadeS: 0.1, lamps: 3 });
  light.set(estimate([lamp(7, [0, 1, 0])]));
  const index = light.lamps.findIndex((one) => one.intensity > 0.9);
  light.update(estimate([lamp(8, [1, 0, 0]), lamp(7, [0, 0.8, 0.6])]), 1);
  for (let k = 1; k < 20; k++) light.update(estimate([lamp(8, [1, 0, 0]), lamp(7, [0, 0.8, 0.6])]), 1 + k / 10);
  assert.ok(light.lamps[index]!.position.z > 5);
  light.update(estimate([lamp(7, [-1, 0, 0])], undefined, 2), 2.92);
  assert.ok(light.lamps[index]!.position.x > -0.1, "the old lamp fades where it was");
});

test("more lamps than there is room for do no harm", () => {
  const light = new ProbeLight({ lamps: 2 });
  light.set(estimate([1, 2, 3, 4].map((id) => lamp(id, NORMALS[id]!))));
  for (let k = 1; k < 50; k++) light.update(estimate([5, 6, 7].map((id) => lamp(id + k, NORMALS[id]!))), k / 10);
  assert.equal(light.lamps.length, 2);
  assert.ok(light.lamps.every((one) => Number.isFinite(one.intensity)));
});

test("shadows are as soft as the lamp is large", () => {
  const options = { lamps: 1, shadowMapSize: 1000, shadowRegionM: 1, shadowHeightM: 0.5 };
  const radius = (deg: number): number => {
    const light = new ProbeLight(options);
    light.set(estimate([{ ...lamp(1, [0, 1, 0]), angularRadiusDeg: deg }]));
    return light.lamps[0]!.shadow.radius;
  };
  assert.ok(Math.abs(radius(5) - (0.5 * Math.tan((5 * Math.PI) / 180) * 1000) / 2) < 1e-6);
  assert.ok(radius(10) > 1.9 * radius(5));
});

test("a light says when there is light, and when there is none any more, as XREstimatedLight does", () => {
  const light = new ProbeLight(), told: string[] = [];
  for (const type of ["estimationstart", "estimationend"] as const) light.addEventListener(type, (event) => told.push(event.type));
  const lit = estimate([lamp(1, [0, 1, 0])]);
  for (const one of [undefined, lit, lit, undefined, undefined]) light.update(one, told.length);
  light.set(lit);
  assert.deepEqual(told, ["estimationstart", "estimationend", "estimationstart"]);
});

/** Luminance of what is shown on a surface that faces up, sideways and down. */
const shown = (light: ProbeLight): number[] => ([[0, 1, 0], [1, 0, 0], [0, -1, 0]] as Vec3[]).map((normal) => light.irradiance(normal)[1]);

test("the fallback is the same in every client", () => {
  assert.ok(Object.keys(fallbacks).length > 3);
  for (const [name, wanted] of Object.entries(fallbacks)) {
    const last = name ? decode(bytes(name)) : undefined;
    const found = fallbackEstimate(last?.kind === "estimate" ? last.estimate : undefined).sh.coefficients;
    wanted.forEach((value, i) => assert.ok(Math.abs(found[i]! - value) <= 1e-5 * Math.abs(value), `${name} ${i}: ${found[i]}, expected ${value}`));
  }
});

test("before the first estimate a fallback is shown, from the first frame on", () => {
  const light = new ProbeLight();
  light.update(undefined, 5);
  const [up, side, down] = shown(light) as [number, number, number];
  assert.ok(up > side && side > down && down > 0.5, `${up} ${side} ${down}`);
  const own = new ProbeLight({ fallback: () => estimate([lamp(1, [0, 1, 0], [3, 3, 3])]) });
  own.update(undefined, 5);
  assert.ok(Math.abs(shown(own)[0]! - 3) < 1e-9);
});

test("after the last estimate the light fades to a fallback that is as bright in the mean", () => {
  const light = new ProbeLight(), last = estimate([lamp(1, [0, 1, 0], [40, 40, 40])], Array.from({ length: 27 }, (_, i) => (i < 3 ? 30 : 0)));
  light.set(last);
  for (let k = 0; k < 100; k++) light.update(undefined, k / 30);
  assert.ok(Math.abs(meanIrradiance(fallbackEstimate(last)) / meanIrradiance(last) - 1) < 1e-9);
  assert.ok(Math.abs(shown(light)[1]! / meanIrradiance(last) - 1) < 1e-3);
  assert.equal(sum(light) < 1e-3, true);
});

test("a pause of the page is no long step of a fade", () => {
  const light = new ProbeLight();
  const lit = estimate([lamp(1, [0, 1, 0], [40, 40, 40])]);
  light.set(lit);
  light.update(lit, 1);
  light.update(undefined, 4);
  assert.ok(shown(light)[0]! > 20, `${shown(light)[0]} of 40 in the first frame after 3 s`);
});

const ambient = (value: number): number[] => Array.from({ length: 27 }, (_, i) => (i < 3 ? value : 0.1 * value * Math.sin(i)));

test("strength multiplies all light, and it fades to another strength", () => {
  const lit = estimate([lamp(1, [0.6, 0.8, 0], [3, 2, 1])], ambient(1.5)), light = new ProbeLight({ strength: 0.5 });
  light.set(lit);
  for (const n of NORMALS) irradiance(lit, n).forEach((value, c) => assert.ok(Math.abs(light.irradiance(n)[c]! - 0.5 * value) < 1e-9));
  light.shown.strength = 2;
  light.update(lit, 1);
  light.update(lit, 1.01);
  const [up] = light.irradiance([0, 1, 0]), [wanted] = irradiance(lit, [0, 1, 0]);
  assert.ok(up > 0.5 * wanted && up < 0.8 * wanted, `${up} of ${wanted}`);
  for (const wrong of [-1, NaN]) assert.throws(() => { light.shown.strength = wrong; }, RangeError);
  assert.throws(() => new ProbeLight({ neutral: 1.5 }), RangeError);
});

test("neutral goes over to a grey light of the same mean irradiance", () => {
  const lit = estimate([lamp(1, [0.6, 0.8, 0], [3, 2, 1])], ambient(1.5)), grey = fallbackEstimate(lit);
  for (const neutral of [0, 0.3, 1]) {
    const light = new ProbeLight({ neutral });
    light.set(lit);
    for (const n of NORMALS)
      irradiance(lit, n).forEach((value, c) => assert.ok(Math.abs(light.irradiance(n)[c]! - (1 - neutral) * value - neutral * irradiance(grey, n)[c]!) < 1e-9));
  }
  const light = new ProbeLight({ neutral: 1 });
  light.set(lit);
  assert.ok(Math.abs(irradiance(grey, [1, 0, 0])[0] - meanIrradiance(lit)) < 1e-9 && sum(light) === 0);
});

test("at a place, the light is that of estimateAt, however the probe stands", () => {
  const near = { ...lamp(1, [0.6, 0.8, 0], [3, 2, 1]), distanceM: 2, distanceSigma: 0.1 }, lit = estimate([near], ambient(1.5));
  const light = new ProbeLight({ yawDeg: 90, at: [0, 0.5, -1] }); // the scene's −Z is to the right of the probe's: its +X
  light.set(lit);
  const there = estimateAt(lit, [1, 0.5, 0]);
  for (const n of NORMALS) irradiance(there, n).forEach((value, c) => assert.ok(Math.abs(light.irradiance([n[2], n[1], -n[0]])[c]! - value) < 1e-9));
  light.at(undefined);
  light.set(lit);
  assert.ok(Math.abs(light.irradiance([0, 1, 0])[0] - irradiance(lit, [0, 1, 0])[0]) < 1e-9);
  assert.throws(() => light.at([0, NaN, 0]), RangeError);
});

test("a reflection map of an earlier boot is not shown, and a clock that goes back holds nothing up", () => {
  const lit = estimate([lamp(1, [0, 1, 0], [3, 2, 1])], ambient(1.5)), light = new ProbeLight();
  light.set(lit);
  const faces = Array.from({ length: 6 }, () => new Float32Array(3).fill(7));
  const map = { sequence: 1, bootId: lit.bootId, captureTimeUnixMs: 0, subscription: 0, kind: "AMBIENT" as const, size: 1, faces, orientation: undefined };
  assert.equal(light.shown.reflection(map).map.faces[0]![0], 7);
  assert.notEqual(light.shown.reflection({ ...map, bootId: lit.bootId + 1 }).map.faces[0]![0], 7);
  const dark = estimate([], ambient(0));
  light.update(dark, 1000);
  light.update(dark, 1);
  light.update(dark, 1.1);
  light.update(dark, 1.2);
  assert.ok(light.irradiance([0, 1, 0])[0] < 0.5 * irradiance(lit, [0, 1, 0])[0]);
});

test("exposure: a factor, or such that white is about half of full brightness", () => {
  const lit = estimate([lamp(1, [0, 1, 0], [300, 300, 300])], ambient(150));
  const fixed = new ProbeLight({ exposure: 0.01 }), own = new ProbeLight({ exposure: "auto" });
  for (const light of [fixed, own]) light.set(lit);
  assert.ok(Math.abs(shown(fixed)[0]! - 0.01 * irradiance(lit, [0, 1, 0])[1]) < 1e-9);
  assert.ok(Math.abs((shown(own)[0]! / irradiance(lit, [0, 1, 0])[1]) * meanIrradiance(lit) - Math.PI / 2) < 1e-9);
  own.set(undefined); // the fallback is as bright as the last light
  assert.ok(Math.abs(shown(own)[1]! - Math.PI / 2) < 1e-9);
});
