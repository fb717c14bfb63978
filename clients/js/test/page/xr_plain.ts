// SPDX-License-Identifier: Apache-2.0
/** A WebXR page without an engine, as the specification's examples are. Called by shim.test.ts. */

import { reflectionMapTurned } from "../../src/reflection_place.js";
import { isAsBefore } from "../../src/scene_map.js";
import type { LightprobeWebXR } from "../../src/shim/main.js";
import type { XRLightEstimate, XRLightProbe } from "../../src/shim/interfaces.js";

type Lit = XRSession & { requestLightProbe(init?: { reflectionFormat?: string }): Promise<XRLightProbe>; preferredReflectionFormat: string };
type LitFrame = XRFrame & { getLightEstimate(probe: XRLightProbe): XRLightEstimate | null };
type Binding = { getReflectionCubeMap(probe: XRLightProbe): WebGLTexture | null };
type BindingClass = new (session: XRSession, gl: WebGL2RenderingContext) => Binding;

/** One frame's estimate as numbers; null: there was none. */
type Numbers = { sh: number[]; direction: number[]; intensity: number[]; atMs: number } | null;

const gl = document.createElement("canvas").getContext("webgl2", { xrCompatible: true })!;
let session: Lit | undefined, probe: XRLightProbe | undefined, binding: Binding | undefined;
const frames: Numbers[] = [];
let changes = 0, periodMs = 0, lastMs = -Infinity;

const numbers = (estimate: XRLightEstimate | null): Numbers => estimate && {
  sh: [...estimate.sphericalHarmonicsCoefficients], atMs: performance.now(),
  direction: [estimate.primaryLightDirection.x, estimate.primaryLightDirection.y, estimate.primaryLightDirection.z],
  intensity: [estimate.primaryLightIntensity.x, estimate.primaryLightIntensity.y, estimate.primaryLightIntensity.z],
};

function onFrame(timeMs: number, frame: XRFrame): void {
  void session?.requestAnimationFrame(onFrame);
  if (!probe || timeMs - lastMs < periodMs) return;
  lastMs = timeMs;
  frames.push(numbers((frame as LitFrame).getLightEstimate(probe)));
}

/** Starts a session, and asks for its light where `format` is given; `period`: least time between two questions, in milliseconds. */
async function start(init: XRSessionInit, format?: string, period = 0): Promise<{ enabled: string[]; preferred: string; type: string }> {
  session = (await navigator.xr!.requestSession("immersive-ar", init)) as Lit;
  const layer = new XRWebGLLayer(session, gl);
  await session.updateRenderState({ baseLayer: layer });
  frames.length = changes = 0;
  periodMs = period;
  probe = binding = undefined;
  if (format !== undefined) {
    probe = await session.requestLightProbe({ reflectionFormat: format });
    probe.addEventListener("reflectionchange", () => { changes++; });
    binding = new (window as unknown as { XRWebGLBinding: BindingClass }).XRWebGLBinding(session, gl);
  }
  void session.requestAnimationFrame(onFrame);
  return { enabled: [...(session.enabledFeatures ?? [])], preferred: session.preferredReflectionFormat, type: Object.prototype.toString.call(probe?.probeSpace) };
}

/** What the client of the page's session has now, and what the frames were given since the last call. */
function look(): { estimate: unknown; state: string | undefined; frames: Numbers[]; changes: number } {
  const source = (window as unknown as { lightprobeWebXR?: LightprobeWebXR }).lightprobeWebXR?.of(session!);
  return { estimate: source?.probe.latest() ?? null, state: source?.probe.state, frames: frames.splice(0), changes };
}

function shader(kind: number, source: string): WebGLShader {
  const one = gl.createShader(kind)!;
  gl.shaderSource(one, source);
  gl.compileShader(one);
  if (!gl.getShaderParameter(one, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(one) ?? "shader");
  return one;
}

let program: WebGLProgram | undefined;
function lookUpProgram(): WebGLProgram {
  if (program) return program;
  program = gl.createProgram();
  gl.attachShader(program, shader(gl.VERTEX_SHADER, "#version 300 es\nvoid main() { gl_Position = vec4(0.0, 0.0, 0.0, 1.0); gl_PointSize = 1.0; }"));
  gl.attachShader(program, shader(gl.FRAGMENT_SHADER, "#version 300 es\nprecision highp float; uniform samplerCube cube; uniform vec3 towards; out vec4 colour; void main() { colour = vec4(texture(cube, towards).rgb, 1.0); }"));
  gl.linkProgram(program);
  return program;
}

/**
 * What a shader of the page reads from the reflection cube map along directions; undefined: there is none. An engine has left another
 * texture bound and pictures to be turned upside down: `kept` says whether this is still so.
 */
function mirrored(towards: [number, number, number][]): { colours: number[][]; kept: boolean; error: number; internal: string } | undefined {
  const mine = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, mine);
  gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const texture = binding!.getReflectionCubeMap(probe!);
  const kept = gl.getParameter(gl.TEXTURE_BINDING_CUBE_MAP) === mine && gl.getParameter(gl.UNPACK_FLIP_Y_WEBGL) === true && gl.getParameter(gl.UNPACK_ALIGNMENT) === 1;
  if (!texture) return undefined;
  gl.getExtension("EXT_color_buffer_float");
  const target = gl.createTexture(), framebuffer = gl.createFramebuffer();
  gl.bindTexture(gl.TEXTURE_2D, target);
  gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA32F, 1, 1);
  gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
  gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
  gl.viewport(0, 0, 1, 1);
  gl.useProgram(lookUpProgram());
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  const colours = towards.map((direction) => {
    gl.uniform3f(gl.getUniformLocation(program!, "towards"), ...direction);
    gl.drawArrays(gl.POINTS, 0, 1);
    const rgba = new Float32Array(4);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.FLOAT, rgba);
    return [...rgba.subarray(0, 3)];
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  return { colours, kept, error: gl.getError(), internal: texture.constructor.name };
}

/** The name of the error that `call` throws. */
async function errorOf(call: () => unknown): Promise<string> {
  try {
    await call();
    return "none";
  } catch (error) {
    return (error as Error).name;
  }
}

/** What a page does wrong, and what it is told. */
async function wrongs(): Promise<Record<string, string>> {
  const plain = (await navigator.xr!.requestSession("immersive-ar")) as Lit, told: Record<string, string> = {};
  told["a session that did not ask"] = await errorOf(() => plain.requestLightProbe());
  await plain.end();
  const first = (await navigator.xr!.requestSession("immersive-ar", { requiredFeatures: ["light-estimation"] })) as Lit;
  told["no such format"] = await errorOf(() => first.requestLightProbe({ reflectionFormat: "jpeg" }));
  const ofFirst = await first.requestLightProbe();
  await first.end();
  told["a session that has ended"] = await errorOf(() => first.requestLightProbe());
  const second = (await navigator.xr!.requestSession("immersive-ar", { requiredFeatures: ["light-estimation"] })) as Lit;
  await second.updateRenderState({ baseLayer: new XRWebGLLayer(second, gl) });
  const mine = new (window as unknown as { XRWebGLBinding: BindingClass }).XRWebGLBinding(second, gl);
  told["a map of another session"] = await errorOf(() => mine.getReflectionCubeMap(ofFirst));
  told["an estimate of another session"] = await new Promise((done) => {
    void second.requestAnimationFrame((_, frame) => { void errorOf(() => (frame as LitFrame).getLightEstimate(ofFirst)).then(done); });
  });
  told["what is no probe"] = await errorOf(() => mine.getReflectionCubeMap(3 as unknown as XRLightProbe));
  await second.end();
  return told;
}

/** Milliseconds of each call: of an estimate, and of a map that is new, and of one that is not. */
function times(rounds: number): Promise<{ estimateMs: number[]; newMapMs: number[]; sameMapMs: number[] }> {
  const found = { estimateMs: [] as number[], newMapMs: [] as number[], sameMapMs: [] as number[] };
  let isNew = false;
  probe!.addEventListener("reflectionchange", () => { isNew = true; });
  return new Promise((done) => {
    const measure = (_: number, frame: XRFrame): void => {
      const start = performance.now();
      (frame as LitFrame).getLightEstimate(probe!);
      const then = performance.now();
      binding!.getReflectionCubeMap(probe!);
      found.estimateMs.push(then - start);
      (isNew ? found.newMapMs : found.sameMapMs).push(performance.now() - then);
      isNew = false;
      if (found.newMapMs.length >= rounds) done(found);
      else void session!.requestAnimationFrame(measure);
    };
    void session!.requestAnimationFrame(measure);
  });
}

/** Milliseconds, median, of what is done when a map comes, before a frame asks for it: turned into the session's axes, and compared with the one before. */
function turnMs(rounds: number): { texels: number; ms: number } {
  const { map } = (window as unknown as { lightprobeWebXR: LightprobeWebXR }).lightprobeWebXR.of(session!)!.map!, all: number[] = [];
  for (let i = 0; i < rounds; i++) {
    const start = performance.now();
    isAsBefore({ map, key: 1, gain: 1 }, reflectionMapTurned(map, [0, 0.6, 0, 0.8]), 1);
    all.push(performance.now() - start);
  }
  return { texels: map.size, ms: all.sort((a, b) => a - b)[Math.floor(rounds / 2)]! };
}

const end = (): Promise<void> => session!.end();

Object.assign(window, { start, look, mirrored, wrongs, times, turnMs, end, ready: true });
