// SPDX-License-Identifier: Apache-2.0
/** In Chromium: the ground as the viewer samples it, and plates that mirror it. Called by ar.test.ts. */
import * as THREE from "three";
import type { Estimate, ReflectionMap, Vec3 } from "../../src/index.js";
import { Ground, gainByAlbedo, gainByReflectionMap } from "../../web/ground.js";
import { groundToPixels, type Pinhole, type Pose } from "../../web/pose.js";
import { SurfaceMaterial } from "../../web/surface.js";
import { mippedCube } from "../../web/surroundings.js";
import { COLUMNS, plates } from "./surface.js";
import { cameraFrom, pixel, renderer } from "./picture.js";

const MIRROR = { albedo: [0, 0, 0], atNormal: [1, 1, 1], highlight: "none", powers: [1, 1], reflection: 1, refraction: 0, indexRatio: 1, detail: 0 } as const;

interface Asked { picture: string; pinhole: Pinhole; pose: Pose; sideM: number; map: ReflectionMap; estimate: Estimate; probeM: number; normals: Vec3[]; heightM: number; white: number }

/** The canvas is that of the viewer: sRGB, upper row first. */
function textureOf({ picture, pinhole: { widthPx, heightPx } }: Asked): THREE.Texture {
  const canvas = new OffscreenCanvas(widthPx, heightPx), bytes = Uint8ClampedArray.from(atob(picture), (letter) => letter.charCodeAt(0));
  canvas.getContext("2d")!.putImageData(new ImageData(bytes, widthPx, heightPx), 0, 0);
  const texture = new THREE.CanvasTexture(canvas);
  texture.colorSpace = THREE.SRGBColorSpace;
  return texture;
}

function mirrored(asked: Asked): { rgba: number[]; albedo: number; byMap: number; colours: Vec3[] } {
  const ground = new Ground(renderer, asked.sideM), material = new SurfaceMaterial(MIRROR);
  ground.sample(textureOf(asked), asked.pinhole.widthPx, asked.pinhole.heightPx, groundToPixels(asked.pose, asked.pinhole));
  const texels = ground.read(), byMap = gainByReflectionMap(texels, asked.map, asked.probeM);
  material.setSurroundings(mippedCube(asked.map));
  material.setGround({ texture: ground.texture, sideM: asked.sideM, gain: byMap });
  renderer.toneMapping = THREE.LinearToneMapping;
  renderer.toneMappingExposure = 1 / asked.white;
  const mesh = new THREE.Mesh(plates(asked.normals, 1), material), camera = cameraFrom(1);
  mesh.position.y = asked.heightM;
  camera.position.y = asked.heightM;
  camera.updateMatrixWorld();
  renderer.render(new THREE.Scene().add(mesh), camera);
  const colours = asked.normals.map((_, k) => pixel(((k % COLUMNS) + 0.5) / COLUMNS, (Math.floor(k / COLUMNS) + 0.5) / COLUMNS).map((value) => value * asked.white) as unknown as Vec3);
  return { rgba: [...texels.rgba], albedo: gainByAlbedo(texels, asked.estimate), byMap, colours };
}

Object.assign(window, { mirrored });
