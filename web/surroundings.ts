// SPDX-License-Identifier: Apache-2.0
/** What shiny objects mirror, as textures: of the reflection map, or where there is none of the ambient light. */
import { LinearMipmapLinearFilter, PMREMGenerator, type CubeTexture, type Texture, type WebGLRenderer, type WebGLRenderTarget } from "three";
import type { Estimate, ReflectionMap } from "../src/index.js";
import { ambientEnvironment, reflectionTexture } from "../src/three.js";

/** A cube texture with mip levels, whose values are to be multiplied by `intensity`. */
export interface Cube { texture: CubeTexture; intensity: number }

export function mippedCube(map: ReflectionMap): Cube {
  const cube = reflectionTexture(map);
  cube.texture.generateMipmaps = true;
  cube.texture.minFilter = LinearMipmapLinearFilter;
  return cube;
}

export class Surroundings {
  readonly #pmrem: PMREMGenerator;
  #target: WebGLRenderTarget | undefined;
  #madeMs = -Infinity;
  /** Undefined: there is no reflection map, and formulas take the SH. */
  cube: Cube | undefined;
  intensity = 1;

  constructor(renderer: WebGLRenderer) {
    this.#pmrem = new PMREMGenerator(renderer);
  }

  /** Filtered for three.js' physical materials. */
  get texture(): Texture | null {
    return this.#target?.texture ?? null;
  }

  /** It is made anew every `periodMs`, because that is the dearest part of a frame. */
  update(estimate: Estimate | undefined, map: ReflectionMap | undefined, nowMs: number, periodMs: number): void {
    if (!estimate || nowMs - this.#madeMs <= periodMs) return;
    this.#madeMs = nowMs;
    this.#target?.dispose();
    this.cube?.texture.dispose();
    this.cube = map && mippedCube(map);
    this.intensity = this.cube?.intensity ?? 1;
    this.#target = this.cube ? this.#pmrem.fromCubemap(this.cube.texture) : this.#ofAmbient(estimate);
  }

  #ofAmbient(estimate: Estimate): WebGLRenderTarget {
    const map = ambientEnvironment(estimate), target = this.#pmrem.fromEquirectangular(map);
    map.dispose();
    return target;
  }
}
