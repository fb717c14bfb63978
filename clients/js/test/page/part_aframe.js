// SPDX-License-Identifier: Apache-2.0
// A scene of A-Frame with `lightprobe`.
import { FLOOR_Y, options, serveThree } from "./part.js";

const { url, exposure, reflections, strength } = options;
document.body.insertAdjacentHTML("beforeend", `<a-scene embedded xr-mode-ui="enabled: false" style="width: 300px; height: 300px">
  <a-entity id="light" lightprobe="url: ${url}; exposure: ${exposure}; reflections: ${reflections}; strength: ${strength}"></a-entity>
  <a-sphere id="ball" radius="1" segments-width="192" segments-height="96" shadow="cast: true"></a-sphere>
  <a-plane id="floor" position="0 ${FLOOR_Y} 0" rotation="-90 0 0" width="8" height="8" shadow="receive: true"></a-plane>
  <a-camera position="0 1.6 4"></a-camera></a-scene>`);

const mesh = (id) => document.getElementById(id)?.getObject3D?.("mesh"), scene = document.querySelector("a-scene");
serveThree(() => {
  const light = document.getElementById("light").components?.lightprobe?.light, ball = mesh("ball"), floor = mesh("floor");
  return light && ball && floor && scene.renderStarted ? { THREE: window.AFRAME.THREE, renderer: scene.renderer, scene: scene.object3D, ball, floor, light } : undefined;
});
