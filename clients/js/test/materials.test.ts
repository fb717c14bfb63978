// SPDX-License-Identifier: Apache-2.0
/** In headless Chromium: each of the viewer's materials against lightprobe.shading, within 2/255. */
import assert from "node:assert/strict";
import { execFileSync } from "node:child_process";
import { resolve } from "node:path";
import { after, before, test } from "node:test";
import type { Browser, Page } from "playwright-core";
import type { Estimate, Light, ReflectionMap, Vec3 } from "../src/index.js";
import { SURFACES } from "../web/materials.js";
import type { Surface } from "../web/surface.js";
import { LONG_MS, launch, pageWith } from "./chromium.js";
import { ROOT } from "./golden.js";

let browser: Browser, page: Page;

before(async () => {
  browser = await launch();
  page = await pageWith(browser, "surface.ts");
}, { timeout: LONG_MS });

after(async () => { await browser?.close(); });

function unit(vector: Vec3): Vec3 {
  const [x, y, z] = vector, length = Math.hypot(x, y, z);
  return [x / length, y / length, z / length];
}

const lamp = (id: number, towards: Vec3, irradiance: Vec3): Partial<Light> => ({ id, direction: unit(towards), irradiance, angularRadiusDeg: 1 });

const COEFFICIENTS = [1.5, 1.4, 1.3, 0.3, 0.2, 0.1, -0.3, 0.2, 0.1, 0.2, -0.2, 0.3, 0.2, 0.1, -0.2, 0.15, 0.1, 0.2, -0.2, 0.3, 0.1, 0.1, -0.1, 0.2, 0.25, 0.1, -0.3];
const LIGHTS = [lamp(1, [0.6, 0.5, 0.6], [1.2, 1, 0.8]), lamp(2, [-0.7, 0.1, 0.5], [0.2, 0.5, 0.9]), lamp(3, [0.3, -0.6, -0.7], [0.8, 0.3, 0.4])];
const ESTIMATE = { bootId: 1, lights: LIGHTS, key: undefined, sh: { kind: "AMBIENT", order: 2, coefficients: COEFFICIENTS } } as unknown as Estimate;

/**
 * Every face has a colour of its own and slopes along both edges. With stripes one texel wide, for surfaces that read a
 * mip level in which nothing is left of them.
 */
function slopingFaces(stripes: boolean): ReflectionMap {
  const size = 32, colours: Vec3[] = [[1, 0.2, 0.3], [0.2, 1, 0.3], [0.1, 0.2, 1], [1, 0.9, 0.1], [1, 0.2, 0.8], [0.1, 1, 0.9]];
  const faces = colours.map((colour) => Float32Array.from({ length: 3 * size * size }, (_, at) => {
    const column = Math.floor(at / 3) % size, row = Math.floor(at / 3 / size);
    const slope = colour[at % 3]! * (0.3 + (0.5 * column) / size) + (0.2 * row) / size;
    return slope * (stripes ? (column % 2 ? 1.5 : 0.5) : 1);
  }));
  return { sequence: 1, bootId: 1, captureTimeUnixMs: 0, subscription: 1, kind: "AMBIENT", size, faces, orientation: undefined };
}

/** Normals all over the sphere, and around those that mirror a lamp into the eye, as far as the highlight reaches. */
function normalsFor(surface: Surface): Vec3[] {
  const spread = Array.from({ length: 240 }, (_, i): Vec3 => {
    const z = 1 - (2 * (i + 0.5)) / 240, radius = Math.sqrt(1 - z * z);
    return [radius * Math.cos(i * 2.399963), radius * Math.sin(i * 2.399963), z];
  });
  const width = 2 / Math.sqrt(Math.min(...surface.powers) + 1);
  const bright = LIGHTS.flatMap(({ direction }) => {
    const [x, y, z] = direction!, side = Math.sign(z), half = unit([x, y, z + side]);
    return Array.from({ length: 40 }, (_, i): Vec3 => {
      const radius = width * Math.sqrt(i / 40);
      return unit([half[0] + radius * Math.cos(i * 2.399963), half[1] + radius * Math.sin(i * 2.399963), half[2]]);
    });
  });
  return [...spread, ...bright];
}

const drawn = (surface: Surface, map: ReflectionMap | undefined, normals: Vec3[], gain: number): Promise<Vec3[]> => page.evaluate(
  ({ surface, estimate, map, normals, gain }) => (window as unknown as { shine: (...all: unknown[]) => Vec3[] }).shine(surface, estimate, map, normals, gain),
  { surface, estimate: ESTIMATE, map, normals, gain });

function expected(surface: Surface, map: ReflectionMap | undefined, normals: Vec3[]): (Vec3 | null)[] {
  const scene = { surface, normals, lights: LIGHTS, coefficients: COEFFICIENTS, map: map ? { size: map.size, faces: map.faces.flatMap((face) => [...face]) } : null };
  const output = execFileSync(resolve(ROOT, "build/venv/bin/python"), [resolve(ROOT, "clients/js/test/shaded.py")], { input: JSON.stringify(scene), maxBuffer: 1 << 26 });
  return JSON.parse(output.toString()) as (Vec3 | null)[];
}

/** Largest difference of pictures in which 1 is white, and how many channels are neither black nor white there. */
function compare(normals: Vec3[], colours: Vec3[], wanted: (Vec3 | null)[], gain: number): { worst: number; where: string; count: number } {
  let worst = 0, where = "", count = 0;
  colours.forEach((colour, i) => wanted[i]?.forEach((value, c) => {
    const shown = Math.min(1, value * gain);
    if (shown > 0.02 && shown < 0.98) count++;
    if (Math.abs(shown - colour[c]!) <= worst) return;
    worst = Math.abs(shown - colour[c]!);
    where = `channel ${c} at normal ${String(normals[i])}: ${colour[c]}, expected ${shown}`;
  }));
  return { worst, where, count };
}

const BRUSHED: Surface = { ...SURFACES.silver, highlight: "ashikhmin-shirley" };

for (const [name, surface] of Object.entries<Surface>({ ...SURFACES, "silver by Ashikhmin and Shirley": BRUSHED }))
  for (const withMap of [false, true])
    test(`${name} is as lightprobe.shading says, ${withMap ? "before a reflection map" : "before the SH"}`, { timeout: LONG_MS }, async () => {
      const map = withMap ? slopingFaces(surface.detail >= 1) : undefined, normals = normalsFor(surface);
      const wanted = expected(surface, map, normals);
      const values = wanted.flatMap((rgb) => rgb ?? []).sort((a, b) => a - b);
      for (const brightest of [values.at(-1)!, values[Math.floor(values.length / 2)]! * 2]) { // highlights, then the rest
        const gain = 0.95 / brightest;
        const { worst, where, count } = compare(normals, await drawn(surface, map, normals, gain), wanted, gain);
        console.log(`${name}, white is ${(1 / gain).toFixed(2)}: ${(255 * worst).toFixed(2)}/255 off at most, ${count} values`);
        assert.ok(count >= 100, `only ${count} values are neither black nor white`);
        assert.ok(worst <= 2 / 255, `${(255 * worst).toFixed(2)}/255 off: ${where}`);
      }
    });
