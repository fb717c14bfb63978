// SPDX-License-Identifier: Apache-2.0
/** Turned axes, as unit quaternions x, y, z, w. */

import type { Vec3 } from "./sh.js";

export type Quaternion = [number, number, number, number];

export const SAME: Quaternion = [0, 0, 0, 1];

/** About +Y, by degrees counter-clockwise as seen from above: −Z is turned to the left. */
export function fromYaw(deg: number): Quaternion {
  const half = (deg * Math.PI) / 360;
  return deg === 0 ? SAME : [0, Math.sin(half), 0, Math.cos(half)];
}

export const inverse = ([x, y, z, w]: Quaternion): Quaternion => [-x, -y, -z, w];

/** v + 2 q × (q × v + w v) */
export function turned([qx, qy, qz, qw]: Quaternion, [x, y, z]: Vec3): Vec3 {
  const tx = 2 * (qy * z - qz * y), ty = 2 * (qz * x - qx * z), tz = 2 * (qx * y - qy * x);
  return [x + qw * tx + qy * tz - qz * ty, y + qw * ty + qz * tx - qx * tz, z + qw * tz + qx * ty - qy * tx];
}
