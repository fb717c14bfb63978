// SPDX-License-Identifier: Apache-2.0
/** In Chromium: what three.js draws in the light of an estimate, in numbers. Called by browser.test.ts. */
import * as THREE from "three";
import type { Estimate, Vec3 } from "../../src/index.js";
import type { ReflectionMap } from "../../src/index.js";
import { ProbeLight, ShadowCatcher, reflectionTexture } from "../../src/three.js";
import { reflectionCubeMap } from "../../src/webxr.js";
import { cameraFrom, onSphere, pixel, renderer } from "./picture.js";

/**
 * A white Lambert sphere, seen from both sides: at each of `count` pixels the normal and the colour, which should be
 * E(normal) / π. Normals are those of the pixels' centres.
 */
function sphere(estimate: Estimate, count: number, turn: [number, number, number, number]): { normal: Vec3; colour: Vec3 }[] {
  const scene = new THREE.Scene(), light = new ProbeLight({ lamps: 8, castShadow: false });
  light.toProbe.set(...turn);
  scene.add(light, new THREE.Mesh(new THREE.SphereGeometry(1, 256, 128), new THREE.MeshLambertMaterial({ color: 0xffffff })));
  light.set(estimate);
  const samples: { normal: Vec3; colour: Vec3 }[] = [];
  for (const side of [1, -1]) {
    renderer.render(scene, cameraFrom(side));
    for (let i = 0; i < count / 2; i++) {
      const radius = 0.92 * Math.sqrt((i + 0.5) / (count / 2)), angle = i * 2.399963;
      samples.push(onSphere(radius * Math.cos(angle), radius * Math.sin(angle), side));
    }
  }
  light.dispose();
  return samples;
}

/** Darkening of a floor by a ball above it, seen from the top: in the middle of the shadow, and far away. */
function catcher(estimate: Estimate): { shadow: Vec3; open: Vec3 } {
  const scene = new THREE.Scene(), light = new ProbeLight({ lamps: 1 });
  scene.background = new THREE.Color(1, 1, 1);
  const floor = new ShadowCatcher(new THREE.PlaneGeometry(4, 4).rotateX(-Math.PI / 2));
  const ball = new THREE.Mesh(new THREE.SphereGeometry(0.25, 64, 32), new THREE.MeshLambertMaterial());
  ball.position.set(0, 0.6, 0);
  ball.castShadow = true;
  ball.material.colorWrite = ball.material.depthWrite = false; // it casts its shadow and hides nothing
  scene.add(light, floor, ball);
  light.set(estimate);
  floor.update(light);
  renderer.shadowMap.enabled = true;
  const camera = new THREE.OrthographicCamera(-1.4, 1.4, 1.4, -1.4, 0.1, 10);
  camera.position.set(0, 5, 0);
  camera.lookAt(0, 0, 0);
  renderer.render(scene, camera);
  renderer.shadowMap.enabled = false;
  light.dispose();
  return { shadow: pixel(0.5, 0.5), open: pixel(0.1, 0.1) };
}

/**
 * A mirror ball, seen from both sides along z: at each pixel of the given ones (x, y in −1…1) the direction that it mirrors
 * and what it shows, in units of radiance. `rough`: through PMREMGenerator, as physical materials need it.
 */
function mirror(map: ReflectionMap, places: [number, number][], rough: boolean): { towards: Vec3; radiance: Vec3 }[] {
  const { texture, intensity } = reflectionTexture(map), unit = Math.max(...map.faces.map((face) => Math.max(...face)));
  const pmrem = new THREE.PMREMGenerator(renderer);
  const gain = intensity / unit; // the brightest texel is white
  const material = rough
    ? new THREE.MeshStandardMaterial({ metalness: 1, roughness: 0, color: 0xffffff, envMap: pmrem.fromCubemap(texture).texture, envMapIntensity: gain })
    : new THREE.MeshBasicMaterial({ envMap: texture, color: new THREE.Color().setScalar(gain) });
  const scene = new THREE.Scene().add(new THREE.Mesh(new THREE.SphereGeometry(1, 256, 128), material));
  const samples: { towards: Vec3; radiance: Vec3 }[] = [];
  for (const side of [1, -1]) {
    const camera = new THREE.PerspectiveCamera(1, 1, 1, 300); // far away: nearly parallel
    camera.position.set(0, 0, (1 / Math.tan(Math.PI / 360)) * side);
    camera.lookAt(0, 0, 0);
    renderer.render(scene, camera);
    for (const [u, v] of places) {
      const { normal: [x, y, z], colour: [r, g, b] } = onSphere(u, v, side);
      const view = new THREE.Vector3(0, 0, -side), normal = new THREE.Vector3(x, y, z);
      samples.push({ towards: view.reflect(normal).toArray() as unknown as Vec3, radiance: [r * unit, g * unit, b * unit] });
    }
  }
  pmrem.dispose();
  texture.dispose();
  return samples;
}

/** What a shader reads from WebXR's cube map along a direction, times `gain`. */
function lookUp(map: ReflectionMap, towards: Vec3[], gain: number): Vec3[] {
  const gl = document.createElement("canvas").getContext("webgl2", { preserveDrawingBuffer: true })!;
  const shader = (kind: number, source: string): WebGLShader => {
    const one = gl.createShader(kind)!;
    gl.shaderSource(one, source);
    gl.compileShader(one);
    if (!gl.getShaderParameter(one, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(one) ?? "shader");
    return one;
  };
  const program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, "#version 300 es\nvoid main() { gl_Position = vec4(0.0, 0.0, 0.0, 1.0); gl_PointSize = 64.0; }"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, "#version 300 es\nprecision highp float; uniform samplerCube cube; uniform vec3 towards; uniform float gain; out vec4 colour; void main() { colour = vec4(gain * texture(cube, towards).rgb, 1.0); }"));
  gl.linkProgram(program);
  gl.useProgram(program);
  const texture = reflectionCubeMap(gl, map), data = new Uint8Array(4);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  gl.uniform1f(gl.getUniformLocation(program, "gain"), gain);
  return towards.map((direction) => {
    gl.uniform3f(gl.getUniformLocation(program, "towards"), ...direction);
    gl.drawArrays(gl.POINTS, 0, 1);
    gl.readPixels(gl.drawingBufferWidth / 2, gl.drawingBufferHeight / 2, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, data);
    return [data[0]! / 255 / gain, data[1]! / 255 / gain, data[2]! / 255 / gain];
  });
}

Object.assign(window, { sphere, catcher, mirror, lookUp });
