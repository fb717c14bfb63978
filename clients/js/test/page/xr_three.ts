// SPDX-License-Identifier: Apache-2.0
/** three.js' WebXR page with light estimation, as its example has it (with #environment, which pages may leave out, all of it); and what its lights do to a white and a mirroring ball. */
import * as THREE from "three";
import { ARButton } from "three/examples/jsm/webxr/ARButton.js";
import { XREstimatedLight } from "three/examples/jsm/webxr/XREstimatedLight.js";
import { readBall, type BallSample } from "./xr_ball.js";

const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera(70, 1, 0.01, 20);
const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
renderer.setSize(320, 320);
renderer.xr.enabled = true;
document.body.append(renderer.domElement);

const defaultLight = new THREE.HemisphereLight(0xffffff, 0xbbbbff, 1);
scene.add(defaultLight);
const xrLight = new XREstimatedLight(renderer), told: string[] = [];
xrLight.addEventListener("estimationstart" as never, () => {
  told.push("start");
  scene.add(xrLight);
  scene.remove(defaultLight);
  if (xrLight.environment && location.hash === "#environment") scene.environment = xrLight.environment;
});
xrLight.addEventListener("estimationend" as never, () => {
  told.push("end");
  scene.add(defaultLight);
  scene.remove(xrLight);
  scene.environment = null;
});
document.body.append(ARButton.createButton(renderer, { optionalFeatures: ["light-estimation"] }));
const ball = new THREE.Mesh(new THREE.SphereGeometry(1, 256, 128), new THREE.MeshLambertMaterial({ color: 0xffffff }));
scene.add(ball);

let pending: (() => void) | undefined, frames = 0;
renderer.setAnimationLoop((_, frame) => {
  renderer.render(scene, camera);
  if (!frame) return;
  frames++;
  pending?.();
  pending = undefined;
});

/** Radiance of a ball in the light of the page, within a frame. */
const radiance = (kind: "lambert" | "standard" | "mirror"): Promise<BallSample[]> => new Promise((done) => {
  pending = () => {
    const { material } = ball;
    if (kind !== "lambert") ball.material = new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: kind === "mirror" ? 0 : 1, metalness: kind === "mirror" ? 1 : 0 }) as never;
    if (kind === "mirror") scene.remove(xrLight);
    const samples = readBall(THREE, renderer, scene);
    if (kind === "mirror") scene.add(xrLight);
    ball.material = material;
    done(samples);
  };
});

Object.assign(window, { radiance, told, xrLight, seen: () => frames, ready: true });
