// SPDX-License-Identifier: Apache-2.0
/** What the viewer uses of js-aruco2, which has no types of its own. */
declare module "js-aruco2" {
  export interface Marker { id: number; hammingDistance: number; corners: { x: number; y: number }[] }
  interface Detector { detect(picture: { width: number; height: number; data: Uint8ClampedArray }): Marker[] }
  const aruco: { AR: { Detector: new (options: { dictionaryName: string; maxHammingDistance?: number }) => Detector } };
  export default aruco;
}
declare module "js-aruco2/src/dictionaries/aruco_4x4_1000.js";
