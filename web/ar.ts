// SPDX-License-Identifier: Apache-2.0
/**
 * The camera of the device behind the objects. If a printed marker lies in sight, the objects stand on it and mirror the ground
 * around it; its upper edge is where the probe looks (−Z).
 */
import { CanvasTexture, Matrix4, SRGBColorSpace, Vector3, type WebGLRenderer } from "three";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { Ground, gainByAlbedo, gainByReflectionMap } from "./ground.js";
import { findMarker } from "./marker.js";
import { cameraPlace, groundToPixels, poseOf, type Pinhole, type Pose } from "./pose.js";
import { DIAMETER_M } from "./materials.js";

/** The marker is as wide as 1.25 balls, whatever its size is. */
const HALF_M = (1.25 * DIAMETER_M) / 2;
/** The square of ground that objects mirror; the row of balls is two metres of the scene long. */
const GROUND_M = 3;
/** The probe is taken to be so high above the marker, when its map tells how bright the ground is. */
const PROBE_M = 0.5;
const LONGEST_SIDE_PX = 640, LOOK_MS = 30, FORGET_MS = 500, GAIN_MS = 500;
/** Share of a new pose that counts, where it differs little from the one before: a still camera gives a still picture. */
const CALM = 0.3, MOVED_M = 0.05;

const vector = (rows: number[][], i: number, sign: number): Vector3 => new Vector3(...(rows[i]!.map((value) => sign * value) as [number, number, number]));

/** A camera's pose as three.js has it: +X right, +Y up, looking along −Z. */
export function matrixOf(pose: Pose): Matrix4 {
  const basis = new Matrix4().makeBasis(vector(pose.rotation, 0, 1), vector(pose.rotation, 1, -1), vector(pose.rotation, 2, -1));
  return basis.setPosition(...(cameraPlace(pose) as [number, number, number]));
}

/** Between two poses; beyond a small move the newer one alone, so that nothing lags. */
function calmed(before: Matrix4 | undefined, now: Matrix4): Matrix4 {
  if (!before) return now;
  const distance = Math.max(...before.elements.map((value, i) => Math.abs(value - now.elements[i]!)));
  if (distance > MOVED_M) return now;
  const [a, b] = [before, now].map((matrix) => [matrix.elements.slice(0, 4), matrix.elements.slice(4, 8), matrix.elements.slice(12, 15)]);
  const between = (i: number): Vector3 => new Vector3(...(a![i]!.slice(0, 3).map((value, k) => value + CALM * (b![i]![k]! - value)) as [number, number, number]));
  const x = between(0).normalize(), z = new Vector3().crossVectors(x, between(1)).normalize();
  return new Matrix4().makeBasis(x, new Vector3().crossVectors(z, x), z).setPosition(between(2));
}

export class ArView {
  readonly #video = document.createElement("video");
  readonly #canvas = document.createElement("canvas");
  readonly #picture = new CanvasTexture(this.#canvas);
  readonly #ground: Ground;
  readonly #fieldDeg: number;
  #place: Matrix4 | undefined;
  #looked = -Infinity;
  #found = -Infinity;
  #gained = -Infinity;
  #gain = 0;

  /** `fieldDeg`: of the camera along the longer side of its picture. */
  constructor(renderer: WebGLRenderer, fieldDeg: number) {
    this.#ground = new Ground(renderer, GROUND_M);
    this.#fieldDeg = fieldDeg;
    this.#picture.colorSpace = SRGBColorSpace;
    this.#video.playsInline = true;
    this.#video.muted = true;
  }

  /** Rejects with what the browser says: no camera, not allowed. */
  async start(): Promise<void> {
    this.#video.srcObject = await navigator.mediaDevices.getUserMedia({ video: { facingMode: "environment", width: { ideal: 1280 } } });
    await this.#video.play();
  }

  stop(): void {
    (this.#video.srcObject as MediaStream | null)?.getTracks().forEach((track) => track.stop());
    this.#video.srcObject = null;
    this.#place = undefined;
  }

  get isOn(): boolean {
    return this.#video.srcObject !== null;
  }

  /** Linear when a material reads it. */
  get picture(): CanvasTexture {
    return this.#picture;
  }

  /** Where the camera is in the scene; undefined: no marker is in sight. */
  get place(): Matrix4 | undefined {
    return this.#place;
  }

  get #pinhole(): Pinhole {
    const { width, height } = this.#canvas;
    return { focalPx: Math.max(width, height) / 2 / Math.tan((this.#fieldDeg * Math.PI) / 360), widthPx: width, heightPx: height };
  }

  /** Field of the part of the picture that a view of this aspect shows, vertical; the rest is cut off on two sides. */
  cover(aspect: number): number {
    const { widthPx, heightPx, focalPx } = this.#pinhole, share = Math.min(1, widthPx / heightPx / aspect), across = Math.min(1, (aspect * heightPx) / widthPx);
    this.#picture.repeat.set(across, share);
    this.#picture.offset.set((1 - across) / 2, (1 - share) / 2);
    return (360 / Math.PI) * Math.atan((share * heightPx) / 2 / focalPx);
  }

  /** The ground for materials; undefined: there is no marker, or no light yet to compare it with. */
  get ground(): { texture: Ground["texture"]; sideM: number; gain: number } | undefined {
    return this.#place && this.#gain > 0 ? { texture: this.#ground.texture, sideM: GROUND_M, gain: this.#gain } : undefined;
  }

  /** Takes the newest picture, and looks for the marker. */
  update(nowMs: number, estimate: Estimate | undefined, map: ReflectionMap | undefined): void {
    const { videoWidth, videoHeight } = this.#video;
    if (!videoWidth || nowMs - this.#looked < LOOK_MS) return;
    this.#looked = nowMs;
    const scale = Math.min(1, LONGEST_SIDE_PX / Math.max(videoWidth, videoHeight));
    const width = Math.round(videoWidth * scale), height = Math.round(videoHeight * scale);
    if (this.#canvas.width !== width || this.#canvas.height !== height) {
      Object.assign(this.#canvas, { width, height });
      this.#picture.dispose();
    }
    const context = this.#canvas.getContext("2d", { willReadFrequently: true })!;
    context.drawImage(this.#video, 0, 0, width, height);
    this.#picture.needsUpdate = true;
    const corners = findMarker(context.getImageData(0, 0, width, height)), pose = corners && poseOf(corners, HALF_M, this.#pinhole);
    if (!pose) {
      if (nowMs - this.#found > FORGET_MS) this.#place = undefined;
      return;
    }
    this.#found = nowMs;
    this.#place = calmed(this.#place, matrixOf(pose));
    this.#ground.sample(this.#picture, width, height, groundToPixels(pose, this.#pinhole));
    if (!estimate || nowMs - this.#gained < GAIN_MS) return;
    this.#gained = nowMs;
    const texels = this.#ground.read();
    this.#gain = map ? gainByReflectionMap(texels, map, PROBE_M) : gainByAlbedo(texels, estimate);
  }
}
