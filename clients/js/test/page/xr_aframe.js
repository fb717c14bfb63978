// SPDX-License-Identifier: Apache-2.0
// What the `reflection` component of an A-Frame scene does to its white ball, in numbers.
import { readBall } from "./xr_ball.js";

const { AFRAME } = window, { THREE } = AFRAME, element = document.querySelector("a-scene");
const component = () => element.components.reflection;

/** Within a frame of the session. */
const radiance = (kind) => new Promise((done) => {
  const session = element.renderer.xr.getSession();
  session.requestAnimationFrame(() => setTimeout(() => {
    const ball = document.getElementById("ball").getObject3D("mesh"), { material } = ball;
    if (kind === "mirror") ball.material = new THREE.MeshStandardMaterial({ color: 0xffffff, roughness: 0, metalness: 1 });
    const light = document.getElementById("main").components.light.light, isOn = light.visible;
    light.visible = kind !== "mirror";
    done(readBall(THREE, element.renderer, element.object3D));
    light.visible = isOn;
    ball.material = material;
  }));
});

Object.assign(window, {
  radiance, enter: () => { void element.enterAR(); },
  isLit: () => Boolean(component().xrLightProbe && element.object3D.environment === component().lightingEstimationTexture && component().probeLight?.components.light.light.sh.coefficients[0].x === 0),
});
