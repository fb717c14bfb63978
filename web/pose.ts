// SPDX-License-Identifier: Apache-2.0
/**
 * Where a pinhole camera is, from the four corners of a square that lies on the ground. The ground is y = 0, the square's middle
 * the origin; its upper edge is towards −Z. The camera's axes: x right, y down, z forward. No lens distortion.
 */

export type Point = readonly [x: number, y: number];

export interface Pinhole { focalPx: number; widthPx: number; heightPx: number }

/** Turns and moves points of the world into the camera's axes: rotation · point + place. */
export interface Pose { rotation: number[][]; place: number[] }

const dot = (a: number[], b: number[]): number => a.reduce((sum, value, i) => sum + value * b[i]!, 0);
const cross = ([a, b, c]: number[], [x, y, z]: number[]): number[] => [b! * z! - c! * y!, c! * x! - a! * z!, a! * y! - b! * x!];
const scaled = (vector: number[], factor: number): number[] => vector.map((value) => factor * value);
const unit = (vector: number[]): number[] => scaled(vector, 1 / Math.sqrt(dot(vector, vector)));

/** Solves rows · x = right (Gauss, with pivots); undefined: there is no one solution. */
function solve(rows: number[][], right: number[]): number[] | undefined {
  const all = rows.map((row, i) => [...row, right[i]!]), count = rows.length;
  for (let k = 0; k < count; k++) {
    let best = k;
    for (let i = k + 1; i < count; i++) if (Math.abs(all[i]![k]!) > Math.abs(all[best]![k]!)) best = i;
    [all[k], all[best]] = [all[best]!, all[k]!];
    const pivot = all[k]!;
    if (Math.abs(pivot[k]!) < 1e-12) return undefined;
    for (let i = 0; i < count; i++) {
      if (i === k) continue;
      const factor = all[i]![k]! / pivot[k]!;
      for (let j = k; j <= count; j++) all[i]![j]! -= factor * pivot[j]!;
    }
  }
  return all.map((row, i) => row[count]! / row[i]!);
}

/** Corners of a square of the ground, clockwise from the upper left as one reads it. */
const square = (half: number): Point[] => [[-half, -half], [half, -half], [half, half], [-half, half]];

/** Rows of the homography from (x, z, 1) of the ground to the picture (Hartley and Zisserman, 2004, 4.1). */
function homography(corners: readonly Point[], half: number): number[][] | undefined {
  const rows: number[][] = [], right: number[] = [];
  square(half).forEach(([x, z], i) => {
    const [u, v] = corners[i]!;
    rows.push([x, z, 1, 0, 0, 0, -u * x, -u * z], [0, 0, 0, x, z, 1, -v * x, -v * z]);
    right.push(u, v);
  });
  const h = solve(rows, right);
  return h && [h.slice(0, 3), h.slice(3, 6), [h[6]!, h[7]!, 1]];
}

/** Rotation by a vector (axis times angle), applied after another (Rodrigues). */
function turned(rotation: number[][], by: number[]): number[][] {
  const angle = Math.sqrt(dot(by, by));
  if (angle < 1e-12) return rotation;
  const axis = scaled(by, 1 / angle), c = Math.cos(angle), s = Math.sin(angle);
  const turn = (v: number[]): number[] => {
    const across = cross(axis, v), along = dot(axis, v) * (1 - c);
    return v.map((value, i) => value * c + across[i]! * s + axis[i]! * along);
  };
  const columns = [0, 1, 2].map((j) => turn(rotation.map((row) => row[j]!)));
  return [0, 1, 2].map((i) => columns.map((column) => column[i]!));
}

export function project(pose: Pose, camera: Pinhole, point: number[]): Point {
  const [x, y, z] = pose.rotation.map((row, i) => dot(row, point) + pose.place[i]!);
  return [camera.focalPx * (x! / z!) + camera.widthPx / 2, camera.focalPx * (y! / z!) + camera.heightPx / 2];
}

function residuals(pose: Pose, camera: Pinhole, corners: readonly Point[], half: number): number[] {
  return square(half).flatMap(([x, z], i) => {
    const [u, v] = project(pose, camera, [x, 0, z]);
    return [u - corners[i]![0], v - corners[i]![1]];
  });
}

/** One step of Gauss and Newton towards the corners. */
function improved(pose: Pose, camera: Pinhole, corners: readonly Point[], half: number): Pose {
  const moved = (step: number[]): Pose => ({ rotation: turned(pose.rotation, step.slice(0, 3)), place: pose.place.map((value, i) => value + step[3 + i]!) });
  const now = residuals(pose, camera, corners, half), small = 1e-6;
  const slopes = Array.from({ length: 6 }, (_, k) => {
    const step = [0, 0, 0, 0, 0, 0];
    step[k] = small;
    return residuals(moved(step), camera, corners, half).map((value, i) => (value - now[i]!) / small);
  });
  const step = solve(slopes.map((a) => slopes.map((b) => dot(a, b))), slopes.map((a) => -dot(a, now)));
  return step ? moved(step) : pose;
}

/**
 * Pose of a camera that sees the square's corners, in pixels, clockwise from the upper left as one reads it. Undefined: the four
 * are no picture of a square in front of the camera.
 */
export function poseOf(corners: readonly Point[], half: number, camera: Pinhole): Pose | undefined {
  const centred = corners.map(([u, v]): Point => [(u - camera.widthPx / 2) / camera.focalPx, (v - camera.heightPx / 2) / camera.focalPx]);
  const h = homography(centred, half);
  if (!h) return undefined;
  const column = (j: number): number[] => h.map((row) => row[j]!);
  const scale = Math.sign(h[2]![2]!) / Math.sqrt(Math.sqrt(dot(column(0), column(0)) * dot(column(1), column(1))));
  const right = unit(scaled(column(0), scale)), towards = scaled(column(1), scale);
  const up = unit(cross(towards, right)), back = cross(right, up);
  let pose: Pose = { rotation: [0, 1, 2].map((i) => [right[i]!, up[i]!, back[i]!]), place: scaled(column(2), scale) };
  for (let i = 0; i < 5; i++) pose = improved(pose, camera, corners, half);
  const error = Math.max(...residuals(pose, camera, corners, half).map(Math.abs));
  const isSeen = pose.place[2]! > 0 && cameraPlace(pose)[1]! > 0;
  return isSeen && error < 0.05 * Math.hypot(corners[0]![0] - corners[2]![0], corners[0]![1] - corners[2]![1]) ? pose : undefined;
}

/** Where the camera is in the world. */
export const cameraPlace = ({ rotation, place }: Pose): number[] => [0, 1, 2].map((j) => -rotation.reduce((sum, row, i) => sum + row[j]! * place[i]!, 0));

/** Rows of the homography from (x, z, 1) of the ground to pixels, times a factor. */
export function groundToPixels({ rotation, place }: Pose, camera: Pinhole): number[][] {
  const [a, b, c] = rotation.map((row, i) => [row[0]!, row[2]!, place[i]!]) as [number[], number[], number[]];
  const pixels = (row: number[], middle: number): number[] => row.map((value, i) => camera.focalPx * value + middle * c[i]!);
  return [pixels(a, camera.widthPx / 2), pixels(b, camera.heightPx / 2), c];
}
