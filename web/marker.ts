// SPDX-License-Identifier: Apache-2.0
/** Finds the printed marker in a picture: that of `lightprobe align marker --print`, OpenCV's DICT_4X4_50. */
import aruco from "js-aruco2";
import "js-aruco2/src/dictionaries/aruco_4x4_1000.js";
import type { Point } from "./pose.js";

/** Of the dictionary with 1000 markers, the first 50 are those of OpenCV's smallest. */
const KNOWN = 50;
/** Wrong bits of sixteen: with one, noise is soon a marker. */
const MOST_WRONG_BITS = 0;
const LEAST_EDGE_PX = 12;
/** An edge is looked for so far to both sides, at so many places, and not near the corners. */
const REACH_PX = 3, PLACES = 12, MARGIN = 0.15;

const detector = new aruco.AR.Detector({ dictionaryName: "ARUCO_4X4_1000", maxHammingDistance: MOST_WRONG_BITS + 1 });

function grey({ data, width, height }: ImageData, x: number, y: number): number {
  const left = Math.min(width - 2, Math.max(0, Math.floor(x - 0.5))), top = Math.min(height - 2, Math.max(0, Math.floor(y - 0.5)));
  const u = Math.min(1, Math.max(0, x - 0.5 - left)), v = Math.min(1, Math.max(0, y - 0.5 - top));
  const at = (column: number, row: number): number => {
    const i = 4 * (row * width + column);
    return 0.299 * data[i]! + 0.587 * data[i + 1]! + 0.114 * data[i + 2]!;
  };
  return (1 - v) * ((1 - u) * at(left, top) + u * at(left + 1, top)) + v * ((1 - u) * at(left, top + 1) + u * at(left + 1, top + 1));
}

interface Line { point: Point; along: Point }

/** The edge between two corners, to a fraction of a pixel: where brightness changes most, and a line through that. */
function edge(picture: ImageData, from: Point, to: Point): Line {
  const length = Math.hypot(to[0] - from[0], to[1] - from[1]), along: Point = [(to[0] - from[0]) / length, (to[1] - from[1]) / length];
  const across: Point = [-along[1], along[0]], offsets: [at: number, offset: number][] = [];
  for (let k = 0; k < PLACES; k++) {
    const at = length * (MARGIN + ((1 - 2 * MARGIN) * (k + 0.5)) / PLACES);
    let sum = 0, weights = 0;
    for (let d = -REACH_PX; d <= REACH_PX; d += 0.5) {
      const value = (shift: number): number => grey(picture, from[0] + along[0] * at + across[0] * (d + shift), from[1] + along[1] * at + across[1] * (d + shift));
      const slope = (value(0.5) - value(-0.5)) ** 2;
      sum += slope * d;
      weights += slope;
    }
    if (weights > 0) offsets.push([at, sum / weights]);
  }
  const count = Math.max(1, offsets.length), mean = (of: (one: [number, number]) => number): number => offsets.reduce((sum, one) => sum + of(one), 0) / count;
  const middle = mean(([at]) => at), offset = mean(([, value]) => value), spread = mean(([at]) => (at - middle) ** 2);
  const slope = spread > 0 ? mean(([at, value]) => (at - middle) * (value - offset)) / spread : 0;
  return {
    point: [from[0] + along[0] * middle + across[0] * offset, from[1] + along[1] * middle + across[1] * offset],
    along: [along[0] + across[0] * slope, along[1] + across[1] * slope],
  };
}

function meeting(a: Line, b: Line): Point {
  const determinant = a.along[0] * b.along[1] - a.along[1] * b.along[0];
  const t = ((b.point[0] - a.point[0]) * b.along[1] - (b.point[1] - a.point[1]) * b.along[0]) / determinant;
  return [a.point[0] + t * a.along[0], a.point[1] + t * a.along[1]];
}

/**
 * Corners of the largest marker, in pixels from the upper left of the picture, clockwise from the upper left as one reads the
 * marker. Undefined: none is in sight.
 */
export function findMarker(picture: ImageData): Point[] | undefined {
  const size = (corners: Point[]): number => Math.min(...corners.map(([x, y], i) => Math.hypot(x - corners[(i + 1) % 4]![0], y - corners[(i + 1) % 4]![1])));
  const found = detector.detect(picture).filter(({ id }) => id < KNOWN)
    .map(({ corners }) => corners.map(({ x, y }): Point => [x + 0.5, y + 0.5]))
    .filter((corners) => size(corners) >= LEAST_EDGE_PX)
    .sort((a, b) => size(b) - size(a))[0];
  if (!found) return undefined;
  const lines = found.map((corner, i) => edge(picture, corner, found[(i + 1) % 4]!));
  return lines.map((line, i) => meeting(lines[(i + 3) % 4]!, line));
}
