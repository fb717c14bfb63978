// SPDX-License-Identifier: Apache-2.0
/** Loads an object of a file, as far as the page can bear it. */
import * as THREE from "three";
import { GLTFLoader, type GLTFLoaderPlugin, type GLTFParser } from "three/examples/jsm/loaders/GLTFLoader.js";
import { dispose } from "./disposed.js";
import { checkObject, checkObjectSize, checkObjectText, checkPictures, trim } from "./object_limits.js";

/** Looks at a document before the loader makes anything of it. */
function checked({ json }: GLTFParser): GLTFLoaderPlugin {
  checkObject(json);
  trim(json);
  return { name: "checked" };
}

function picturesOf(object: THREE.Object3D): Set<{ width: number; height: number }> {
  const pictures = new Set<{ width: number; height: number }>();
  object.traverse((one) => {
    for (const material of one instanceof THREE.Mesh ? [one.material].flat() as THREE.Material[] : [])
      for (const value of Object.values(material) as unknown[]) if (value instanceof THREE.Texture && value.image) pictures.add(value.image as ImageBitmap);
  });
  return pictures;
}

/** Throws what the loader throws, and what keeps the page from it. */
export async function loadedObject(file: File): Promise<THREE.Group> {
  checkObjectSize(file.size);
  const bytes = await file.arrayBuffer();
  checkObjectText(bytes);
  const { scene } = await new GLTFLoader().register(checked).parseAsync(bytes, "");
  try {
    checkPictures([...picturesOf(scene)]);
  } catch (error) {
    dispose(scene);
    throw error;
  }
  return scene;
}
