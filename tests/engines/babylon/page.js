// SPDX-License-Identifier: Apache-2.0
// In Chromium: a sphere in the light of a .glb file, as Babylon.js draws it. Called by draw.js.
import { AppendSceneAsync, Camera, Color3, Color4, Engine, FreeCamera, MeshBuilder, PBRMaterial, Scene, Vector3 } from "@babylonjs/core";
import "@babylonjs/loaders/glTF/2.0/index.js";

const SIZE_PX = 256, PLACES = 60;

function ball(scene, mirror) {
  const material = new PBRMaterial("", scene);
  Object.assign(material, { albedoColor: new Color3(1, 1, 1), metallic: mirror ? 1 : 0, roughness: mirror ? 0 : 1, specularIntensity: mirror ? 1 : 0, environmentBRDFTexture: null });
  MeshBuilder.CreateSphere("", { diameter: 2, segments: 64 }, scene).material = material;
}

/** Far away, because Babylon.js takes the direction towards its place for the view. */
function cameraAt(scene, position) {
  const camera = new FreeCamera("", position.scale(500), scene);
  Object.assign(camera, { mode: Camera.ORTHOGRAPHIC_CAMERA, orthoLeft: -1, orthoRight: 1, orthoBottom: -1, orthoTop: 1, minZ: 490, maxZ: 510 });
  camera.setTarget(Vector3.Zero());
  scene.activeCamera = camera;
  return camera.getViewMatrix(true).clone().invert();
}

/** Normals, directions towards the eye and colours (0…1, gamma 2.2), in glTF's axes. */
window.draw = async (base64, rightHanded, mirror) => {
  const canvas = Object.assign(document.createElement("canvas"), { width: SIZE_PX, height: SIZE_PX });
  const engine = new Engine(canvas, false, { preserveDrawingBuffer: true }), scene = new Scene(engine);
  scene.useRightHandedSystem = rightHanded;
  scene.clearColor = new Color4(0, 0, 0, 1);
  await AppendSceneAsync(`data:model/gltf-binary;base64,${base64}`, scene, { pluginExtension: ".glb" });
  scene.environmentTexture.gammaSpace = false; // Babylon.js takes what it has decoded for sRGB
  if (!rightHanded) scene.environmentTexture.rotationY = Math.PI; // loaded objects are turned, the environment is not
  ball(scene, mirror);
  const toGltf = ({ x, y, z }) => [rightHanded ? x : -x, y, z], samples = [];
  for (const position of [new Vector3(0, 0, 1), new Vector3(0, 0, -1), new Vector3(1, 0, 0), new Vector3(-1, 0, 0)]) {
    const toWorld = cameraAt(scene, position);
    await scene.whenReadyAsync();
    scene.render();
    const pixels = await engine.readPixels(0, 0, SIZE_PX, SIZE_PX);
    for (let i = 0; i < PLACES; i++) {
      const radius = 0.85 * Math.sqrt((i + 0.5) / PLACES), angle = i * 2.399963;
      const [column, row] = [Math.cos(angle), Math.sin(angle)].map((part) => Math.floor(((radius * part + 1) / 2) * SIZE_PX));
      const [x, y] = [column, row].map((place) => (2 * place + 1) / SIZE_PX - 1), z = Math.sqrt(1 - x * x - y * y);
      const normal = Vector3.TransformNormal(new Vector3(x, y, rightHanded ? z : -z), toWorld), at = 4 * (row * SIZE_PX + column);
      samples.push({ normal: toGltf(normal), view: toGltf(position), colour: [...pixels.slice(at, at + 3)].map((value) => value / 255) });
    }
  }
  engine.dispose();
  return samples;
};
