// SPDX-License-Identifier: Apache-2.0
// An app of react-three-fiber with `<ProbeLight>`.
import { Canvas } from "@react-three/fiber";
import { createElement as h } from "react";
import { createRoot } from "react-dom/client";
import * as THREE from "three";
import { ProbeLight } from "../../src/react.js";
import { FLOOR_Y, options, serveThree } from "./part.js";

let state;
const found = (name) => state.scene.getObjectByName(name);
const light = () => state?.scene.children.find((one) => one.lamps && one.probe);

const root = Object.assign(document.createElement("div"), { style: "width: 300px; height: 300px" });
document.body.append(root);
createRoot(root).render(h(Canvas, { shadows: true, camera: { position: [0, 1, 5] }, onCreated: (one) => { state = one; } },
  h(ProbeLight, options),
  h("mesh", { name: "ball", castShadow: true }, h("sphereGeometry", { args: [1, 192, 96] }), h("meshStandardMaterial")),
  h("mesh", { name: "floor", receiveShadow: true, position: [0, FLOOR_Y, 0], rotation: [-Math.PI / 2, 0, 0] }, h("planeGeometry", { args: [8, 8] }), h("meshStandardMaterial"))));
serveThree(() => (light() ? { THREE, renderer: state.gl, scene: state.scene, ball: found("ball"), floor: found("floor"), light: light() } : undefined));
