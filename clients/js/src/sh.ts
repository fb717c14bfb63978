// SPDX-License-Identifier: Apache-2.0
/**
 * Real spherical harmonics of incident radiance, orthonormal, without the Condon–Shortley sign: index l(l+1)+m,
 * Y0 = .282095, Y1..3 = .488603 (y, z, x), … Axes of the probe: +X right, +Y up, −Z forward.
 */

export type Vec3 = readonly [number, number, number];

/** Highest order that a probe sends. */
export const MAX_ORDER = 4;

/** Y_i(d) up to an order of at most 4; `d` is a unit vector. Recurrences of Sloan, JCGT 2013. */
export function basis(order: number, d: Vec3): Float64Array {
  return basisInto(order, d[0], d[1], d[2], new Float64Array((order + 1) ** 2));
}

/** The same, written into `out`. */
export function basisInto(order: number, x: number, y: number, z: number, out: Float64Array): Float64Array {
  let cosine = 1, sine = 0, diagonal = 1;
  for (let m = 0; m <= order; m++) {
    let before = 0, here = diagonal;
    for (let l = m; l <= order; l++) {
      const at = l * (MAX_ORDER + 1) + m, centre = l * (l + 1), scale = NORMS[at]! * here;
      out[centre + m] = scale * cosine;
      if (m > 0) out[centre - m] = scale * sine;
      const next = AHEAD[at]! * z * here - BACK[at]! * before;
      before = here;
      here = next;
    }
    const turned = x * cosine - y * sine;
    sine = x * sine + y * cosine;
    cosine = turned;
    diagonal *= 2 * m + 1;
  }
  return out;
}

function norm(l: number, m: number): number {
  let ratio = 1;
  for (let k = l - m + 1; k <= l + m; k++) ratio /= k;
  return Math.sqrt(((2 * l + 1) / (4 * Math.PI)) * ratio * (m > 0 ? 2 : 1));
}

/** Of l and m, at l (MAX_ORDER + 1) + m. */
const tableOf = (value: (l: number, m: number) => number): Float64Array =>
  Float64Array.from({ length: (MAX_ORDER + 1) ** 2 }, (_, i) => value(Math.floor(i / (MAX_ORDER + 1)), i % (MAX_ORDER + 1)));
const NORMS = tableOf(norm), AHEAD = tableOf((l, m) => (2 * l + 1) / (l - m + 1)), BACK = tableOf((l, m) => (l + m) / (l - m + 1));

/** A_l of Ramamoorthi and Hanrahan 2001: from radiance to irradiance. */
const COSINE_LOBE = [Math.PI, (2 * Math.PI) / 3, Math.PI / 4, 0, -Math.PI / 24];

const degreeOf = (index: number): number => Math.floor(Math.sqrt(index));

function dot(coefficients: ArrayLike<number>, weights: ArrayLike<number>): [number, number, number] {
  const sum: [number, number, number] = [0, 0, 0];
  for (let i = 0; i < weights.length; i++)
    for (let c = 0; c < 3; c++) sum[c]! += (coefficients[3 * i + c] ?? 0) * weights[i]!;
  return sum;
}

export const orderOf = (coefficients: ArrayLike<number>): number => Math.sqrt(coefficients.length / 3) - 1;

/** E(n) = Σ A_l L_i Y_i(n); coefficients r0 g0 b0 r1 … */
export function irradiance(coefficients: ArrayLike<number>, normal: Vec3): [number, number, number] {
  const weights = basis(orderOf(coefficients), normal);
  return dot(coefficients, weights.map((value, i) => value * COSINE_LOBE[degreeOf(i)]!));
}

/** Band-limited radiance from a direction; it may ring below zero. */
export function radiance(coefficients: ArrayLike<number>, direction: Vec3): [number, number, number] {
  return dot(coefficients, basis(orderOf(coefficients), direction));
}

/** Weights of terms of the unit normal x, y, z: 1, x, y, z, xy, yz, zx, 3z² − 1, x² − y²; RGB. */
export type Polynomial = Record<"one" | "x" | "y" | "z" | "xy" | "yz" | "zx" | "zz" | "xx", [number, number, number]>;

/** E(n) / π of the first nine coefficients, as shaders compute it. */
export function polynomial(coefficients: ArrayLike<number>): Polynomial {
  const term = (i: number, weight: number): [number, number, number] => [0, 1, 2].map((c) => weight * (coefficients[3 * i + c] ?? 0)) as [number, number, number];
  const first = 0.32573500793527993, second = 0.2731371076480198; // A_l / π times the constants of the basis
  return {
    one: term(0, 0.28209479177387814), x: term(3, first), y: term(1, first), z: term(2, first), xy: term(4, second), yz: term(5, second), zx: term(7, second),
    zz: term(6, 0.07884789131313001), xx: term(8, second / 2),
  };
}

/** Add a lamp of this irradiance at normal incidence, as a point. */
export function addLamp(coefficients: number[], direction: Vec3, light: Vec3): void {
  const weights = basis(orderOf(coefficients), direction);
  for (let i = 0; i < weights.length; i++)
    for (let c = 0; c < 3; c++) coefficients[3 * i + c]! += weights[i]! * light[c]!;
}

/** Directions whose order-2 bases are independent, band by band. */
const PROBES: Vec3[] = ([[1, 0, 0], [0, 0, 1], [0.6, 0.8, 0], [0.6, 0, 0.8], [0, 0.6, 0.8]] as Vec3[]);

/**
 * The first nine coefficients seen from axes that are turned: `toProbe` takes a direction in the new axes to the
 * probe's. Within a band, a function's values at 2l+1 directions determine it.
 */
export function rotate(coefficients: ArrayLike<number>, toProbe: (d: Vec3) => Vec3): number[] {
  const out: number[] = Array.from({ length: 27 }, () => 0);
  for (let c = 0; c < 3; c++) out[c] = coefficients[c] ?? 0;
  for (let l = 1; l <= 2 && 3 * l * l < coefficients.length; l++) {
    const size = 2 * l + 1, first = l * l;
    const probes = l === 1 ? AXES : PROBES;
    const matrix = probes.map((d) => Array.from(basis(l, d).slice(first)));
    const values = probes.map((d) => {
      const turned = basis(l, toProbe(d)).slice(first);
      return [0, 1, 2].map((c) => turned.reduce((sum, y, i) => sum + y * (coefficients[3 * (first + i) + c] ?? 0), 0));
    });
    const solved = solve(matrix, values);
    for (let i = 0; i < size; i++) for (let c = 0; c < 3; c++) out[3 * (first + i) + c] = solved[i]![c]!;
  }
  return out;
}

const AXES: Vec3[] = [[1, 0, 0], [0, 1, 0], [0, 0, 1]];

/** Gaussian elimination with pivoting; destroys its arguments. */
function solve(matrix: number[][], values: number[][]): number[][] {
  const size = matrix.length;
  for (let i = 0; i < size; i++) {
    let pivot = i;
    for (let r = i + 1; r < size; r++) if (Math.abs(matrix[r]![i]!) > Math.abs(matrix[pivot]![i]!)) pivot = r;
    [matrix[i], matrix[pivot]] = [matrix[pivot]!, matrix[i]!];
    [values[i], values[pivot]] = [values[pivot]!, values[i]!];
    for (let r = 0; r < size; r++) {
      if (r === i) continue;
      const factor = matrix[r]![i]! / matrix[i]![i]!;
      for (let k = i; k < size; k++) matrix[r]![k]! -= factor * matrix[i]![k]!;
      values[r] = values[r]!.map((value, c) => value - factor * values[i]![c]!);
    }
  }
  return values.map((row, i) => row.map((value) => value / matrix[i]![i]!));
}
