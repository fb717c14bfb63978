// SPDX-License-Identifier: Apache-2.0
// Babylon.js' WebXR page with light estimation, as its documentation has it; and what its lights do to a white and a mirroring ball.
import { Camera, Color3, Color4, Constants, Engine, FreeCamera, MeshBuilder, PBRMaterial, RenderTargetTexture, Scene, Vector3, WebXRFeatureName } from "@babylonjs/core";
import { SIDES, pictureSize, places } from "./xr_ball.js";

const canvas = Object.assign(document.createElement("canvas"), { width: 320, height: 320 });
document.body.append(canvas);
const engine = new Engine(canvas, true), scene = new Scene(engine);
scene.useRightHandedSystem = location.hash === "#right";
scene.clearColor = new Color4(0, 0, 0, 0);
new FreeCamera("camera", new Vector3(0, 1, 3), scene);
const ball = MeshBuilder.CreateSphere("ball", { diameter: 2, segments: 96 }, scene);
const chalk = new PBRMaterial("chalk", scene), mirror = new PBRMaterial("mirror", scene);
Object.assign(chalk, { metallic: 0, roughness: 1, albedoColor: Color3.White(), metallicF0Factor: 0, specularIntensity: 0, forceIrradianceInFragment: true });
Object.assign(mirror, { metallic: 1, roughness: 0, albedoColor: Color3.White() });
ball.material = chalk;
scene.imageProcessingConfiguration.applyByPostProcess = true; // materials give linear colours

let light, frames = 0;
scene.createDefaultXRExperienceAsync({
  uiOptions: { sessionMode: "immersive-ar", referenceSpaceType: "local-floor" },
  disableTeleportation: true, disablePointerSelection: true, disableHandTracking: true, disableNearInteraction: true,
}).then((xr) => {
  light = xr.baseExperience.featuresManager.enableFeature(WebXRFeatureName.LIGHT_ESTIMATION, "latest", { setSceneEnvironmentTexture: true, createDirectionalLightSource: true });
  xr.baseExperience.sessionManager.onXRFrameObservable.add(() => { frames++; });
  engine.runRenderLoop(() => scene.render());
  Object.assign(window, { enter: () => { void xr.baseExperience.enterXRAsync("immersive-ar", "local-floor"); }, ready: true });
});

/** Where a direction of WebXR lies in the scene. */
const inScene = ([x, y, z], by = 1) => new Vector3(by * x, by * y, by * (scene.useRightHandedSystem ? z : -z));

/** Off the screen, linear, in 32-bit floats. */
async function seenFrom([back, up]) {
  const eye = new FreeCamera("eye", inScene(back, 500), scene, false), target = new RenderTargetTexture("target", pictureSize, scene, { type: Constants.TEXTURETYPE_FLOAT, generateMipMaps: false });
  Object.assign(eye, { mode: Camera.ORTHOGRAPHIC_CAMERA, orthoLeft: -1, orthoBottom: -1, orthoRight: 1, orthoTop: 1, minZ: 400, maxZ: 600, upVector: inScene(up) });
  eye.setTarget(Vector3.Zero());
  Object.assign(target, { activeCamera: eye, renderList: [ball], clearColor: new Color4(0, 0, 0, 1) });
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

/** Radiance of a ball in the light of the page: white, or a mirror, which the main light does not reach. */
async function radiance(kind) {
  ball.material = kind === "mirror" ? mirror : chalk;
  light.directionalLight.setEnabled(kind !== "mirror");
  const samples = [];
  for (const side of SIDES) {
    const rgba = await seenFrom(side);
    for (const { at, normal } of places(side)) samples.push({ normal, view: side[0], radiance: [...rgba.slice(4 * at, 4 * at + 3)] });
  }
  return samples;
}

Object.assign(window, {
  radiance, seen: () => frames,
  isLit: () => Boolean(light?.xrLightingEstimate && light.reflectionCubeMapTexture?._texture?.isReady),
});
