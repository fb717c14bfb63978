// SPDX-License-Identifier: Apache-2.0
/** Gives back what an object that is shown no more holds of the graphics memory. No DOM in this file. */
import * as THREE from "three";

/** What is shown around a material is the stage's own: it goes on. */
const NOT_ITS_OWN = "envMap";

function disposeMaterial(material: THREE.Material): void {
  for (const [name, value] of Object.entries(material)) {
    if (!(value instanceof THREE.Texture) || name === NOT_ITS_OWN) continue;
    value.dispose();
    (value.source.data as Partial<ImageBitmap> | null)?.close?.(); // the picture itself, which glTF has as an ImageBitmap
  }
  material.dispose();
}

/** Geometries, materials and their textures of an object and all in it. It cannot be shown again. */
export function dispose(object: THREE.Object3D): void {
  object.traverse((one) => {
    if (one instanceof THREE.SkinnedMesh) one.skeleton.dispose();
    if (one instanceof THREE.InstancedMesh) one.dispose();
    if (!(one instanceof THREE.Mesh || one instanceof THREE.Line || one instanceof THREE.Points)) return;
    (one.geometry as THREE.BufferGeometry).dispose();
    for (const material of [one.material].flat() as THREE.Material[]) disposeMaterial(material);
  });
}
