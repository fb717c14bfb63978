// SPDX-License-Identifier: Apache-2.0
// A scene of Babylon.js with ProbeLight.
import { Camera, Color3, Color4, Constants, Engine, FreeCamera, MeshBuilder, PBRMaterial, RenderTargetTexture, Scene, Vector3 } from "@babylonjs/core";
import { ProbeLight } from "../../src/babylon.js";
import { FLOOR_HALF, FLOOR_Y, isRightHanded, options, serve, settled, spotsOf } from "./part.js";
import { SIDES, pictureSize, places } from "./xr_ball.js";

const canvas = Object.assign(document.createElement("canvas"), { width: 300, height: 300 });
document.body.append(canvas);
const engine = new Engine(canvas, true), scene = new Scene(engine);
scene.useRightHandedSystem = isRightHanded;
scene.clearColor = new Color4(0, 0, 0, 0);
new FreeCamera("camera", new Vector3(0, 1, 5), scene).setTarget(Vector3.Zero());
const ball = MeshBuilder.CreateSphere("ball", { diameter: 2, segments: 96 }, scene), floor = MeshBuilder.CreateGround("floor", { width: 8, height: 8 }, scene);
floor.position.y = FLOOR_Y;
const chalk = new PBRMaterial("chalk", scene), mirror = new PBRMaterial("mirror", scene);
Object.assign(chalk, { metallic: 0, roughness: 1, albedoColor: Color3.White(), metallicF0Factor: 0, specularIntensity: 0, forceIrradianceInFragment: true });
Object.assign(mirror, { metallic: 1, roughness: 0, albedoColor: Color3.White() });
ball.material = floor.material = chalk;
scene.imageProcessingConfiguration.applyByPostProcess = true; // materials give linear colours

const light = new ProbeLight(scene, options);
light.addShadowCaster(ball);
floor.receiveShadows = true;
engine.runRenderLoop(() => scene.render());

/** Where a direction of right-handed axes lies in the scene. */
const inScene = ([x, y, z], by = 1) => new Vector3(by * x, by * y, by * (isRightHanded ? z : -z));

/** Off the screen, linear, in 32-bit floats, rows from below. */
async function seenFrom([back, up], half, meshes) {
  const eye = new FreeCamera("eye", inScene(back, 500), scene, false), target = new RenderTargetTexture("target", pictureSize, scene, { type: Constants.TEXTURETYPE_FLOAT, generateMipMaps: false });
  Object.assign(eye, { mode: Camera.ORTHOGRAPHIC_CAMERA, orthoLeft: -half, orthoBottom: -half, orthoRight: half, orthoTop: half, minZ: 400, maxZ: 600, upVector: inScene(up) });
  eye.setTarget(Vector3.Zero());
  Object.assign(target, { activeCamera: eye, renderList: meshes, clearColor: new Color4(0, 0, 0, 1) });
  while (!target.isReadyForRendering()) await new Promise((done) => setTimeout(done, 50));
  const rgba = await new Promise((done) => {
    scene.onAfterRenderObservable.addOnce(() => {
      target.render();
      done(target.readPixels());
    });
  });
  target.dispose();
  eye.dispose();
  return rgba;
}

async function radiance(kind) {
  ball.material = kind === "mirror" ? mirror : chalk;
  for (const lamp of light.lamps) lamp.setEnabled(kind !== "mirror");
  const samples = [];
  for (const side of SIDES) {
    const rgba = await seenFrom(side, 1, [ball]);
    for (const { at, normal } of places(side)) samples.push({ normal, view: side[0], radiance: [...rgba.slice(4 * at, 4 * at + 3)] });
  }
  for (const lamp of light.lamps) lamp.setEnabled(true);
  ball.material = chalk;
  return samples;
}

const shadow = async () => spotsOf(await seenFrom(SIDES[3], FLOOR_HALF, [ball, floor]));
serve({ radiance, shadow, isReady: () => scene.isReady() && settled(light), hasMap: () => scene.environmentTexture.getSize().width > 1 && scene.environmentTexture._prefiltered, packet: () => light.probe.latest() });
