// SPDX-License-Identifier: Apache-2.0
// What <model-viewer xr-environment> takes of the light.
const element = document.querySelector("model-viewer");
const scene = () => element[Object.getOwnPropertySymbols(element).find((one) => one.description === "scene")];
const light = () => scene()?.children.find((one) => one.lightProbe);

Object.assign(window, {
  enter: () => { void element.activateAR(); },
  isLit: () => Boolean(light() && scene().environment === light().environment && light().lightProbe.sh.coefficients[0].x === 0),
  lights: () => ({
    direction: light().directionalLight.position.clone().normalize().toArray(), intensity: light().directionalLight.intensity,
    colour: light().directionalLight.color.toArray(), sh: light().lightProbe.sh.coefficients[0].toArray(),
  }),
});
