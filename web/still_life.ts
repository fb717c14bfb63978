// SPDX-License-Identifier: Apache-2.0
/** A still life of turned and bent forms, each of another material: a vase, a head, a teapot, a goblet, a knot and a ball. Metres; the floor is y = 0. */
import { BufferGeometry, CatmullRomCurve3, Group, LatheGeometry, Mesh, SphereGeometry, TorusKnotGeometry, TubeGeometry, Vector2, Vector3, type Material } from "three";
import { PHYSICAL } from "./materials.js";

export type Piece = keyof typeof PHYSICAL;
type Outline = readonly (readonly [radiusM: number, heightM: number])[];

/** Half the width of what is to be seen. */
export const STILL_LIFE_HALF_M = 0.62;

const VASE: Outline = [
  [0, 0], [0.075, 0], [0.082, 0.008], [0.078, 0.02], [0.1, 0.07], [0.132, 0.14], [0.142, 0.2], [0.13, 0.26], [0.095, 0.32], [0.058, 0.37], [0.046, 0.41], [0.052, 0.445],
  [0.076, 0.475], [0.08, 0.482], [0.074, 0.484], [0.048, 0.45], [0.038, 0.41], [0.05, 0.37], [0.085, 0.32], [0, 0.3],
];
const POT: Outline = [
  [0, 0], [0.085, 0], [0.092, 0.006], [0.094, 0.014], [0.124, 0.05], [0.14, 0.095], [0.132, 0.14], [0.104, 0.175], [0.074, 0.19], [0.07, 0.194], [0.07, 0.2],
  [0.062, 0.21], [0.036, 0.222], [0.014, 0.228], [0.011, 0.236], [0.02, 0.247], [0.022, 0.256], [0.014, 0.267], [0, 0.27],
];
/** Outside and inside: its wall is that of {@link PHYSICAL}.goblet. */
const GOBLET: Outline = [
  [0, 0], [0.072, 0], [0.075, 0.004], [0.068, 0.009], [0.03, 0.018], [0.011, 0.035], [0.009, 0.06], [0.01, 0.1], [0.018, 0.118], [0.05, 0.14], [0.075, 0.175], [0.083, 0.22],
  [0.078, 0.27], [0.071, 0.302], [0.068, 0.304], [0.066, 0.302], [0.072, 0.27], [0.076, 0.22], [0.068, 0.18], [0.045, 0.15], [0, 0.138],
];
/** A neck and a head, before {@link face} gives it one. */
const HEAD: Outline = [
  [0, 0], [0.1, 0], [0.106, 0.006], [0.098, 0.016], [0.066, 0.034], [0.056, 0.065], [0.056, 0.105], [0.062, 0.132], [0.08, 0.152], [0.094, 0.185], [0.103, 0.225], [0.109, 0.265],
  [0.108, 0.3], [0.1, 0.332], [0.083, 0.358], [0.058, 0.376], [0.028, 0.385], [0, 0.387],
];

const HEAD_ROWS = 120;

/** Turned on a lathe; between the points of the outline the curve is smooth. */
function turned(outline: Outline, around = 64): LatheGeometry {
  const curve = new CatmullRomCurve3(outline.map(([x, y]) => new Vector3(x, y, 0)), false, "centripetal");
  const points = curve.getPoints(3 * outline.length).map(({ x, y }) => new Vector2(Math.max(0, x), y));
  return new LatheGeometry(points, around);
}

/** 1 in the middle of a feature of the head, and fading from there; widths in metres. */
const bump = (x: number, y: number, atX: number, atY: number, wideX: number, wideY: number): number => Math.exp(-(((x - atX) / wideX) ** 2) - ((y - atY) / wideY) ** 2);

/** How far a point of the head's front is moved forwards: brow, eyes, nose, cheeks, lips and chin. */
function face(x: number, y: number): number {
  const side = Math.abs(x), nose = Math.min(1, Math.max(0, (0.272 - y) / 0.06)) * bump(x, y, 0, 0.228, 0.012 + 0.1 * Math.max(0, 0.25 - y), 0.034);
  return 0.007 * bump(side, y, 0.032, 0.281, 0.035, 0.012) - 0.014 * bump(side, y, 0.034, 0.258, 0.02, 0.014) + 0.009 * bump(side, y, 0.034, 0.256, 0.012, 0.008)
    + 0.027 * nose + 0.005 * bump(side, y, 0.05, 0.222, 0.022, 0.02) + 0.007 * bump(x, y, 0, 0.192, 0.02, 0.005) + 0.008 * bump(x, y, 0, 0.181, 0.018, 0.006)
    - 0.005 * bump(x, y, 0, 0.1865, 0.022, 0.0025) + 0.014 * bump(x, y, 0, 0.157, 0.028, 0.014);
}

function head(): BufferGeometry {
  const curve = new CatmullRomCurve3(HEAD.map(([x, y]) => new Vector3(x, y, 0)), false, "centripetal");
  const geometry = new LatheGeometry(curve.getPoints(HEAD_ROWS - 1).map(({ x, y }) => new Vector2(Math.max(0, x), y)), 80), position = geometry.getAttribute("position");
  for (let i = 0; i < position.count; i++) {
    const [x, y, z] = [position.getX(i), position.getY(i), position.getZ(i)], above = Math.min(1, Math.max(0, (y - 0.11) / 0.06));
    const narrow = 1 - 0.22 * above, back = z < 0 ? 0.02 * above * bump(0, y, 0, 0.28, 1, 0.08) : 0;
    const front = z > 0 ? Math.min(1, z / 0.04) : 0;
    position.setXYZ(i, x * narrow, y, z * (1 - 0.08 * above) - back + front * above * (0.008 + face(x * narrow, y)));
  }
  geometry.computeVertexNormals();
  closeSeam(geometry, HEAD_ROWS);
  return geometry;
}

/** The first and the last column of a lathe are at the same place: they get one normal. */
function closeSeam(geometry: BufferGeometry, rows: number): void {
  const normal = geometry.getAttribute("normal"), last = normal.count - rows;
  for (let i = 0; i < rows; i++) {
    const mean = new Vector3(normal.getX(i) + normal.getX(last + i), normal.getY(i) + normal.getY(last + i), normal.getZ(i) + normal.getZ(last + i)).normalize();
    for (const at of [i, last + i]) normal.setXYZ(at, mean.x, mean.y, mean.z);
  }
}

/** Along points in the plane of the teapot's handle. */
function tube(points: [x: number, y: number][], radiusM: number): TubeGeometry {
  return new TubeGeometry(new CatmullRomCurve3(points.map(([x, y]) => new Vector3(x, y, 0))), 24, radiusM, 14);
}

function piece(name: Piece, geometry: BufferGeometry, [x, y, z]: [number, number, number]): Mesh<BufferGeometry, Material> {
  const mesh = new Mesh<BufferGeometry, Material>(geometry, PHYSICAL[name]);
  mesh.name = name;
  mesh.position.set(x, y, z);
  mesh.castShadow = true;
  mesh.receiveShadow = name === "chalk" || name === "plastic";
  return mesh;
}

function teapot(x: number, z: number): Group {
  const pot = new Group(), handle = tube([[0.118, 0.155], [0.17, 0.175], [0.205, 0.14], [0.19, 0.08], [0.128, 0.052]], 0.011);
  const spout = tube([[-0.115, 0.07], [-0.16, 0.09], [-0.18, 0.14], [-0.215, 0.185]], 0.019);
  pot.add(...[turned(POT), handle, spout].map((geometry) => piece("copper", geometry, [0, 0, 0])), piece("copper", new SphereGeometry(0.019, 24, 16), [-0.215, 0.185, 0]));
  pot.position.set(x, 0, z);
  pot.rotation.y = 0.5;
  return pot;
}

/** Its meshes are named after what they are made of. */
export function stillLife(): Group {
  const group = new Group(), knot = piece("plastic", new TorusKnotGeometry(0.075, 0.027, 128, 16), [0.17, 0.105, 0.26]), bust = piece("skin", head(), [0.02, 0, -0.17]);
  knot.rotation.set(-1.25, 0, 0.4);
  bust.rotation.y = 0.25;
  group.add(piece("chalk", turned(VASE), [-0.34, 0, -0.14]), bust, teapot(0.41, -0.06), piece("goblet", turned(GOBLET), [-0.14, 0, 0.16]), knot,
    piece("chrome", new SphereGeometry(0.075, 48, 32), [-0.38, 0.075, 0.2]));
  return group;
}
