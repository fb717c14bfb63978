// SPDX-License-Identifier: Apache-2.0
// An app of PlayCanvas with ProbeLight.
import * as pc from "playcanvas";
import { ProbeLight } from "../../src/playcanvas.js";
import { FLOOR_HALF, FLOOR_Y, options, serve, settled, spotsOf } from "./part.js";
import { SIDES, pictureSize, places } from "./xr_ball.js";

const canvas = Object.assign(document.createElement("canvas"), { width: 300, height: 300 });
document.body.append(canvas);
const app = new pc.Application(canvas, { graphicsDeviceOptions: { antialias: false } });
app.start();

function shape(type, chalk) {
  const entity = new pc.Entity(type);
  entity.addComponent("render", { type });
  entity.render.material = chalk;
  app.root.addChild(entity);
  return entity;
}
const chalk = new pc.StandardMaterial(), mirror = new pc.StandardMaterial();
Object.assign(chalk, { useMetalness: false, specular: new pc.Color(0, 0, 0), gloss: 0 });
Object.assign(mirror, { useMetalness: true, metalness: 1, gloss: 1 });
for (const one of [chalk, mirror]) one.update();
const ball = shape("sphere", chalk), floor = shape("plane", chalk);
ball.render.meshInstances[0].mesh = pc.Mesh.fromGeometry(app.graphicsDevice, new pc.SphereGeometry({ radius: 1, latitudeBands: 96, longitudeBands: 192 }));
ball.render.receiveShadows = false;
floor.setLocalScale(8, 1, 8);
floor.setLocalPosition(0, FLOOR_Y, 0);

const light = new ProbeLight(app, options);
light.apply(app.root);

const texture = new pc.Texture(app.graphicsDevice, { width: pictureSize, height: pictureSize, format: pc.PIXELFORMAT_RGBA32F, mipmaps: false, minFilter: pc.FILTER_NEAREST, magFilter: pc.FILTER_NEAREST });
const target = new pc.RenderTarget({ colorBuffer: texture, depth: true }), eye = new pc.Entity("eye");
eye.addComponent("camera", { projection: pc.PROJECTION_ORTHOGRAPHIC, clearColor: new pc.Color(0, 0, 0, 1), renderTarget: target, gammaCorrection: pc.GAMMA_NONE, toneMapping: pc.TONEMAP_NONE });
app.root.addChild(eye);

/** Off the screen, linear, in 32-bit floats, rows from below. `away`: in metres; shadows are near the camera. */
async function seenFrom([back, up], half, away) {
  Object.assign(eye.camera, { orthoHeight: half, nearClip: away - 3, farClip: away + 3 });
  eye.setPosition(...back.map((value) => value * away));
  eye.lookAt(pc.Vec3.ZERO, new pc.Vec3(...up));
  for (let i = 0; i < 2; i++) await new Promise((done) => app.once("frameend", done)); // one that began before is not of this camera
  const { gl } = app.graphicsDevice, rgba = new Float32Array(4 * pictureSize * pictureSize), bound = gl.getParameter(gl.READ_FRAMEBUFFER_BINDING);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, target.impl._glFrameBuffer); // Texture.read() does not return in headless Chromium
  gl.readPixels(0, 0, pictureSize, pictureSize, gl.RGBA, gl.FLOAT, rgba);
  gl.bindFramebuffer(gl.READ_FRAMEBUFFER, bound);
  return rgba;
}

async function radiance(kind) {
  floor.enabled = false;
  ball.render.material = kind === "mirror" ? mirror : chalk;
  const samples = [];
  for (const side of SIDES) {
    const rgba = await seenFrom(side, 1, 500);
    for (const { at, normal } of places(side)) samples.push({ normal, view: side[0], radiance: [...rgba.slice(4 * at, 4 * at + 3)] });
  }
  floor.enabled = true;
  ball.render.material = chalk;
  return samples;
}

const shadow = async () => spotsOf(await seenFrom(SIDES[3], FLOOR_HALF, 5));
serve({ radiance, shadow, isReady: () => settled(light), hasMap: () => Boolean(app.scene.envAtlas), packet: () => light.probe.latest() });
