// SPDX-License-Identifier: Apache-2.0
/** In lightprobe-aframe.js this stands for "three": A-Frame brings its own three.js, and objects of two of them do not mix. */

type Three = typeof import("three");
declare const AFRAME: { THREE: Three } | undefined;
if (typeof AFRAME === "undefined") throw new Error("lightprobe-aframe.js: A-Frame is not there: load aframe.js before it");

/** As three.ts imports them. */
export const {
  CubeReflectionMapping, CubeTexture, DataTexture, DataUtils, DirectionalLight, EquirectangularReflectionMapping, FloatType, Group, HalfFloatType, LightProbe, LinearFilter,
  LinearSRGBColorSpace, Mesh, MeshLambertMaterial, MultiplyBlending, PMREMGenerator, Quaternion, RGBAFormat, Vector3,
} = AFRAME.THREE;
