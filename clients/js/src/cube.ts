// SPDX-License-Identifier: Apache-2.0
/** Reflection maps as cube textures of a page's own WebGL context. What engines remember of its state stays as it was. */

import type { ReflectionMap } from "./reflection.js";

/** Half floats end here. */
const MOST_HALF = 65504;

/** RGBA of the six faces +X −X +Y −Y +Z −Z: half floats, or bytes with sRGB's curve. */
export interface CubeTexels {
  size: number;
  faces: (Uint16Array<ArrayBuffer> | Uint8Array<ArrayBuffer>)[];
}

type Context = WebGLRenderingContext | WebGL2RenderingContext;

const FLOAT = new Float32Array(1), BITS = new Uint32Array(FLOAT.buffer);

/** Bits of the half float next to a value of 0 or more; what is larger than half floats are is the largest of them. */
export function halfFloat(value: number): number {
  if (!(value > 0)) return 0;
  if (value >= MOST_HALF) return 0x7bff;
  if (value < 2 ** -14) return Math.round(value * 2 ** 24); // no exponent below this one
  FLOAT[0] = value;
  return (BITS[0]! - (112 << 23) + 0x1000) >>> 13; // rounded by half of what is cut off; the exponent counts from 15, not from 127
}

/** sRGB's code, 0…255, of a linear value. */
export function srgbCode(value: number): number {
  const linear = Math.min(1, Math.max(0, value));
  return Math.round(255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055));
}

/** A map, times `gain`, as WebGL takes it. */
export function cubeTexels(map: ReflectionMap, format: "srgba8" | "rgba16f", gain = 1): CubeTexels {
  const texels = map.size * map.size, isHalf = format === "rgba16f", code = isHalf ? halfFloat : srgbCode;
  return {
    size: map.size,
    faces: map.faces.map((rgb) => {
      const rgba = isHalf ? new Uint16Array(4 * texels) : new Uint8Array(4 * texels);
      for (let i = 0; i < texels; i++) {
        for (let c = 0; c < 3; c++) rgba[4 * i + c] = code(gain * rgb[3 * i + c]!);
        rgba[4 * i + 3] = code(1);
      }
      return rgba;
    }),
  };
}

/** What WebGL calls a format; undefined: this context has none of it. WebGL 1 has them by its extensions. */
function namesOf(gl: Context, isHalf: boolean): { internal: number; format: number; type: number } | undefined {
  if ("RGBA16F" in gl) return { internal: isHalf ? gl.RGBA16F : gl.SRGB8_ALPHA8, format: gl.RGBA, type: isHalf ? gl.HALF_FLOAT : gl.UNSIGNED_BYTE };
  if (isHalf) {
    const half = gl.getExtension("OES_texture_half_float");
    return half && gl.getExtension("OES_texture_half_float_linear") ? { internal: gl.RGBA, format: gl.RGBA, type: half.HALF_FLOAT_OES } : undefined;
  }
  const srgb = gl.getExtension("EXT_sRGB");
  return srgb ? { internal: srgb.SRGB_ALPHA_EXT, format: srgb.SRGB_ALPHA_EXT, type: gl.UNSIGNED_BYTE } : undefined;
}

/** How data is unpacked by default. */
function unpackDefaults(gl: Context): [number, number | boolean][] {
  const all: [number, number | boolean][] = [[gl.UNPACK_FLIP_Y_WEBGL, false], [gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false], [gl.UNPACK_ALIGNMENT, 4]];
  if ("UNPACK_ROW_LENGTH" in gl) all.push([gl.UNPACK_ROW_LENGTH, 0], [gl.UNPACK_SKIP_PIXELS, 0], [gl.UNPACK_SKIP_ROWS, 0]);
  return all;
}

/** Runs `upload` while `texture` is bound and nothing changes what is unpacked; then all is as before. */
function undisturbed(gl: Context, texture: WebGLTexture, upload: () => void): void {
  const defaults = unpackDefaults(gl), kept = defaults.map(([name]) => gl.getParameter(name) as number | boolean);
  const bound = gl.getParameter(gl.TEXTURE_BINDING_CUBE_MAP) as WebGLTexture | null;
  const buffer = "PIXEL_UNPACK_BUFFER" in gl ? (gl.getParameter(gl.PIXEL_UNPACK_BUFFER_BINDING) as WebGLBuffer | null) : null;
  const bindBuffer = (one: WebGLBuffer | null): void => { if (buffer && "PIXEL_UNPACK_BUFFER" in gl) gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, one); };
  for (const [name, value] of defaults) gl.pixelStorei(name, value);
  bindBuffer(null);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  upload();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, bound);
  bindBuffer(buffer);
  defaults.forEach(([name], i) => gl.pixelStorei(name, kept[i]!));
}

/**
 * Fills a cube texture, filtered linearly; `isNew`: nothing was in it, or texels of another size or format. False: the context has no
 * such format.
 */
export function fillCube(gl: Context, texture: WebGLTexture, { size, faces }: CubeTexels, isNew = true): boolean {
  const names = namesOf(gl, faces[0] instanceof Uint16Array);
  if (!names) return false;
  undisturbed(gl, texture, () => {
    faces.forEach((rgba, face) => {
      const target = gl.TEXTURE_CUBE_MAP_POSITIVE_X + face;
      if (isNew) gl.texImage2D(target, 0, names.internal, size, size, 0, names.format, names.type, rgba);
      else gl.texSubImage2D(target, 0, 0, 0, size, size, names.format, names.type, rgba);
    });
    if (!isNew) return;
    for (const filter of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_CUBE_MAP, filter, gl.LINEAR);
    for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_CUBE_MAP, wrap, gl.CLAMP_TO_EDGE);
  });
  return true;
}
