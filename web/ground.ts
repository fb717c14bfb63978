// SPDX-License-Identifier: Apache-2.0
/**
 * Local sampling: a square of the ground around the objects, as the AR camera sees it, for reflections downwards. It is
 * host_py/lightprobe/local.py in the browser; the picture stays there.
 */
import { DataUtils, HalfFloatType, LinearFilter, Matrix3, Mesh, NoToneMapping, OrthographicCamera, PlaneGeometry, RawShaderMaterial, Scene, GLSL3, Vector2, WebGLRenderTarget, type Texture, type WebGLRenderer } from "three";
import { irradiance, reflected } from "../src/index.js";
import type { Estimate, ReflectionMap, Vec3 } from "../src/index.js";

const TEXELS = 64;
/** Of what a level surface reflects, where no reflection map tells how bright the ground is. */
const ALBEDO = 0.5;

const FRAGMENT = /* glsl */ `
precision highp float;
uniform sampler2D picture; // linear when it is read
uniform mat3 toPixels;     // from x, z, 1 of the ground
uniform vec2 sizePx;
uniform float side;
out vec4 colour;
const int POINTS = 4;      // along each edge of a texel

/** Red, green and blue, 0 unless all points are in the picture; and whether they are. */
void main() {
  vec3 sum = vec3(0.0);
  bool seen = true;
  for (int k = 0; k < POINTS * POINTS; k++) {
    vec2 within = (vec2(k % POINTS, k / POINTS) + 0.5) / float(POINTS) - 0.5;
    vec2 place = ((gl_FragCoord.xy + within) / float(${TEXELS}) - 0.5) * side;
    vec3 at = toPixels * vec3(place, 1.0);
    vec2 pixel = at.xy / at.z;
    seen = seen && at.z > 0.0 && all(greaterThanEqual(pixel, vec2(0.0))) && all(lessThanEqual(pixel, sizePx));
    sum += texture(picture, vec2(pixel.x, sizePx.y - pixel.y) / sizePx).rgb;
  }
  colour = seen ? vec4(sum / float(POINTS * POINTS), 1.0) : vec4(0.0);
}`;

/** The square's texels as numbers: red, green, blue and whether it was seen, rows from −Z, columns from −X. */
export interface Texels { size: number; sideM: number; rgba: Float32Array }

/** Factor that brings the picture into the estimate's units, if the ground reflects ALBEDO of the light on it. */
export function gainByAlbedo({ rgba }: Texels, estimate: Estimate): number {
  let sum = 0, count = 0;
  for (let i = 0; i < rgba.length; i += 4) {
    sum += (rgba[i]! + rgba[i + 1]! + rgba[i + 2]!) / 3;
    count += rgba[i + 3]!;
  }
  const up = irradiance(estimate, [0, 1, 0]);
  return sum > 0 ? (ALBEDO * (up[0] + up[1] + up[2])) / 3 / Math.PI / (sum / count) : 0;
}

/** The same by a reflection map, as a probe `probeM` above the square's middle sees the ground. */
export function gainByReflectionMap({ size, sideM, rgba }: Texels, map: ReflectionMap, probeM: number): number {
  let seen = 0, wanted = 0;
  for (let i = 0; i < size * size; i++) {
    const x = (((i % size) + 0.5) / size - 0.5) * sideM, z = ((Math.floor(i / size) + 0.5) / size - 0.5) * sideM;
    const length = Math.hypot(x, probeM, z), weight = (probeM / length ** 3) * rgba[4 * i + 3]!;
    const light: Vec3 = reflected(map, [x / length, -probeM / length, z / length]);
    seen += (weight * (rgba[4 * i]! + rgba[4 * i + 1]! + rgba[4 * i + 2]!)) / 3;
    wanted += (weight * (light[0] + light[1] + light[2])) / 3;
  }
  return seen > 0 ? wanted / seen : 0;
}

export class Ground {
  readonly sideM: number;
  readonly #renderer: WebGLRenderer;
  readonly #target = new WebGLRenderTarget(TEXELS, TEXELS, { type: HalfFloatType, minFilter: LinearFilter, magFilter: LinearFilter, depthBuffer: false });
  readonly #uniforms = { picture: { value: null as Texture | null }, toPixels: { value: new Matrix3() }, sizePx: { value: new Vector2() }, side: { value: 0 } };
  readonly #scene = new Scene();
  readonly #camera = new OrthographicCamera();

  constructor(renderer: WebGLRenderer, sideM: number) {
    this.#renderer = renderer;
    this.sideM = sideM;
    this.#uniforms.side.value = sideM;
    this.#scene.add(new Mesh(new PlaneGeometry(2, 2), new RawShaderMaterial({
      glslVersion: GLSL3, uniforms: this.#uniforms, fragmentShader: FRAGMENT, depthTest: false,
      vertexShader: "in vec3 position;\nvoid main() { gl_Position = vec4(position.xy, 0.0, 1.0); }",
    })));
  }

  get texture(): Texture {
    return this.#target.texture;
  }

  /** From a picture in sRGB, upper row first; `toPixels`: rows of {@link groundToPixels}. */
  sample(picture: Texture, widthPx: number, heightPx: number, toPixels: number[][]): void {
    this.#uniforms.picture.value = picture;
    this.#uniforms.sizePx.value.set(widthPx, heightPx);
    this.#uniforms.toPixels.value.set(...(toPixels.flat() as Parameters<Matrix3["set"]>));
    const before = this.#renderer.getRenderTarget(), toneMapping = this.#renderer.toneMapping;
    this.#renderer.toneMapping = NoToneMapping;
    this.#renderer.setRenderTarget(this.#target);
    this.#renderer.render(this.#scene, this.#camera);
    this.#renderer.setRenderTarget(before);
    this.#renderer.toneMapping = toneMapping;
  }

  /** Waits for the graphics processor: not in every frame. */
  read(): Texels {
    const halves = new Uint16Array(4 * TEXELS * TEXELS);
    this.#renderer.readRenderTargetPixels(this.#target, 0, 0, TEXELS, TEXELS, halves);
    return { size: TEXELS, sideM: this.sideM, rgba: Float32Array.from(halves, (half) => DataUtils.fromHalfFloat(half)) };
  }

  dispose(): void {
    this.#target.dispose();
  }
}
