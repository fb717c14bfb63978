// SPDX-License-Identifier: Apache-2.0
/**
 * The viewer: objects in the light of the probe that serves this page, and beside them in the true light when a simulator
 * gives it. In the address: ?probe=ws://… another probe, ?truth=ws://… the truth.
 */
import * as THREE from "three";
import { Probe, irradiance, luminance, meanIrradiance } from "../src/index.js";
import type { Estimate, Vec3 } from "../src/index.js";
import { ProbeLight } from "../src/three.js";
import { ArView } from "./ar.js";
import { show } from "./panel.js";
import { Stage } from "./scene.js";
import { isXrOffered, startXr } from "./xr.js";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const PANEL_PERIOD_MS = 200;
const LAMPS = 4;
const SLOW_MS = 50, WARM_UP_FRAMES = 3;
const STILL = matchMedia("(prefers-reduced-motion: reduce)").matches;

function fail(text: string): never {
  const problem = element("problem");
  problem.textContent = text;
  problem.hidden = false;
  throw new Error(text);
}

function makeRenderer(canvas: HTMLCanvasElement): THREE.WebGLRenderer {
  try {
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, preserveDrawingBuffer: true });
    renderer.shadowMap.enabled = true;
    renderer.shadowMap.type = THREE.VSMShadowMap;
    renderer.toneMapping = THREE.ACESFilmicToneMapping;
    renderer.setPixelRatio(Math.min(2, devicePixelRatio));
    return renderer;
  } catch {
    return fail("This browser has no WebGL 2, which the picture needs: try another browser, or switch on its hardware acceleration. The figures beside it work without.");
  }
}

const address = new URL(location.href);
const probe = new Probe(address.searchParams.get("probe") ?? location.href, { shOrder: 2, maxLights: LAMPS });
const truthAddress = address.searchParams.get("truth");
const truth = truthAddress ? new Probe(truthAddress, { shOrder: 2, maxLights: 8, healthPeriodMs: 0 }) : undefined;

const canvas = element<HTMLCanvasElement>("view");
const renderer = makeRenderer(canvas);
const stage = new Stage(renderer);
const lights = { probe: new ProbeLight({ lamps: LAMPS }), truth: new ProbeLight({ lamps: LAMPS }) };
stage.scene.add(lights.probe, lights.truth);
/** Phones see about 65° along the longer side of their picture; ?fov=DEGREES for another camera. */
const ar = new ArView(renderer, Number(address.searchParams.get("fov") ?? 65));
let exposure = 0;

const checked = (id: string): boolean => element<HTMLInputElement>(id).checked;
const chosen = (id: string): string => element<HTMLSelectElement>(id).value;

/** What the switches leave of an estimate. */
function switched(estimate: Estimate | undefined): Estimate | undefined {
  if (!estimate) return undefined;
  return {
    ...estimate,
    lights: checked("use-lamps") ? estimate.lights : [],
    sh: checked("use-ambient") ? estimate.sh : { ...estimate.sh, coefficients: estimate.sh.coefficients.map(() => 0) },
  };
}

const NORMALS: Vec3[] = Array.from({ length: 100 }, (_, i) => {
  const y = 1 - (2 * (i + 0.5)) / 100, radius = Math.sqrt(1 - y * y), turn = i * 2.399963;
  return [radius * Math.cos(turn), y, radius * Math.sin(turn)];
});

/** Mean error of the light on a white sphere, as a share of its brightest point. */
function errorAgainst(estimate: Estimate | undefined, exact: Estimate | undefined): number | undefined {
  if (!estimate || !exact) return undefined;
  const wanted = NORMALS.map((n) => luminance(irradiance(exact, n))), got = NORMALS.map((n) => luminance(irradiance(estimate, n)));
  const brightest = Math.max(...wanted);
  return brightest > 0 ? wanted.reduce((sum, value, i) => sum + Math.abs(value - got[i]!), 0) / NORMALS.length / brightest : undefined;
}

function renderSide(who: "probe" | "truth", estimate: Estimate | undefined, x: number, width: number, height: number, nowMs: number): void {
  lights.probe.visible = who === "probe";
  lights.truth.visible = who === "truth";
  const map = who === "probe" && estimate && checked("use-ambient") && checked("use-lamps") ? probe.reflectionMap : undefined;
  stage.environment(estimate, map, who, nowMs, 400 + 20 * restMs);
  stage.catcher.update(lights[who]);
  renderer.setViewport(x, 0, width, height);
  renderer.setScissor(x, 0, width, height);
  renderer.render(stage.scene, stage.camera);
}

let panelMs = -Infinity, frames = 0, lastMs = 0, gapMs = 16, restMs = 0, level = 0;

/** On a slow machine fewer pixels, smaller shadow maps, plainer glass, and pauses, so that the page stays alive. */
const LEVELS = [{ pixels: 0.7, shadowMap: 512, plain: false }, { pixels: 0.5, shadowMap: 256, plain: true }];

/** False: rest now. */
function mayDraw(nowMs: number): boolean {
  const passedMs = nowMs - lastMs;
  if (passedMs < restMs) return false;
  lastMs = nowMs;
  if (frames < WARM_UP_FRAMES) return true; // shaders are compiled
  gapMs += 0.3 * (Math.min(passedMs - restMs, 1000) - gapMs);
  restMs = gapMs > SLOW_MS ? gapMs : 0;
  const next = LEVELS[level];
  if (gapMs > SLOW_MS && next) {
    level++;
    renderer.setPixelRatio(next.pixels);
    for (const light of [lights.probe, lights.truth]) light.setShadowMapSize(next.shadowMap);
    if (next.plain) stage.simplifyGlass();
  }
  return true;
}

/** Brightness follows the light slowly, as eyes do. */
function expose(estimate: Estimate | undefined): void {
  if (!estimate) return;
  const wanted = 1.05 / Math.max(1e-9, meanIrradiance(estimate));
  exposure += (exposure === 0 ? 1 : 0.05) * (wanted - exposure);
  renderer.toneMappingExposure = exposure;
}

function countFrame(estimate: Estimate | undefined): void {
  document.body.dataset["frames"] = String(++frames);
  document.body.dataset["sequence"] = String(estimate?.sequence ?? 0);
}

/** A frame of an XR session: the device's own view, and nothing beside it. */
function frameInRoom(nowMs: number): void {
  const estimate = probe.latest(), shown = switched(estimate);
  lights.probe.update(shown, nowMs / 1000);
  lights.probe.visible = true;
  lights.truth.visible = false;
  expose(estimate);
  gapMs += 0.3 * (Math.min(nowMs - lastMs, 1000) - gapMs);
  lastMs = nowMs;
  stage.environment(shown, probe.reflectionMap, "probe", nowMs, Math.max(400, 20 * gapMs)); // costs more than a frame does
  stage.catcher.update(lights.probe);
  renderer.setScissorTest(false);
  renderer.render(stage.scene, stage.camera);
  countFrame(estimate);
}

function frame(nowMs: number): void {
  if (renderer.xr.isPresenting) return frameInRoom(nowMs);
  if (!mayDraw(nowMs)) return;
  const { clientWidth: width, clientHeight: height } = canvas;
  const size = renderer.getSize(new THREE.Vector2());
  if (size.x !== width || size.y !== height) renderer.setSize(width, height, false);
  const estimate = probe.latest(), exact = truth?.latest();
  const beside = truth !== undefined && exact !== undefined && checked("use-truth");
  if (checked("turn") && !STILL) stage.azimuth += 0.004;
  lights.probe.update(switched(estimate), nowMs / 1000);
  lights.truth.update(switched(exact), nowMs / 1000);
  expose(estimate);
  const half = beside ? Math.floor(width / 2) : width;
  updateCamera(nowMs, half / height, estimate);
  stage.aim(half / height);
  renderer.setScissorTest(true);
  renderSide("probe", switched(estimate), 0, half, height, nowMs);
  if (beside) renderSide("truth", switched(exact), half, width - half, height, nowMs);
  element("right").hidden = !beside;
  document.querySelector<HTMLElement>("#legend .truth")!.hidden = !truth;
  if (nowMs - panelMs > PANEL_PERIOD_MS) {
    panelMs = nowMs;
    show(probe, estimate, exact, errorAgainst(estimate, exact));
  }
  countFrame(estimate);
}

function say(problem: string): void {
  element("problem").textContent = problem;
  element("problem").hidden = false;
}

/** The room itself is behind the objects, and a camera's picture is not needed. */
async function enterRoom(): Promise<void> {
  element<HTMLSelectElement>("behind").value = "room";
  hideCamera();
  stage.simplifyGlass(); // the bent picture would be of the objects alone: the room is not in it
  try {
    await startXr(renderer, () => { stage.overPicture(false); });
  } catch (error) {
    return say(`AR: ${String(error)}: allow this page to use the device's sensors, and open it by https: or on this machine`);
  }
  stage.overPicture(true);
  stage.scene.background = null;
}

async function showCamera(): Promise<void> {
  try {
    await ar.start();
  } catch (error) {
    element<HTMLSelectElement>("behind").value = "room";
    return say(`camera: ${String(error)}: allow this page to use a camera, and open it by https: or on this machine`);
  }
  stage.overPicture(true);
  stage.scene.background = ar.picture;
  stage.scene.backgroundIntensity = 1;
  stage.scene.backgroundBlurriness = 0;
}

function hideCamera(): void {
  ar.stop();
  stage.overPicture(false);
  stage.setGround(undefined);
  stage.lookFrom(undefined);
  element("marker").hidden = true;
}

/** The camera's newest picture; the view from the marker, if there is one. */
function updateCamera(nowMs: number, aspect: number, estimate: Estimate | undefined): void {
  if (!ar.isOn) return;
  ar.update(nowMs, estimate, probe.reflectionMap);
  stage.lookFrom(ar.place, ar.cover(aspect));
  const ground = checked("use-ground") ? ar.ground : undefined;
  stage.setGround(ground);
  document.body.dataset["ground"] = ground ? ground.gain.toPrecision(4) : "";
  document.body.dataset["camera"] = ar.place ? ar.place.elements.map((value) => value.toFixed(4)).join(" ") : "";
  element("marker").hidden = ar.place !== undefined;
}

function wire(): void {
  const wish = (): void => probe.subscribe({ shOrder: Number(chosen("order")), maxLights: Number(chosen("lights")), tolerance: Number(chosen("tolerance")) });
  for (const id of ["order", "lights", "tolerance"]) element(id).addEventListener("change", wish);
  element("behind").addEventListener("change", () => {
    if (chosen("behind") === "camera") return void showCamera();
    hideCamera();
  });
  element<HTMLInputElement>("object").addEventListener("change", (event) => {
    const file = (event.target as HTMLInputElement).files?.[0];
    if (file) stage.load(file).catch((error: unknown) => { say(`${file.name}: ${String(error)}: choose a .glb file that holds all it needs`); });
  });
  element("use-formulas").addEventListener("change", () => stage.useFormulas(checked("use-formulas")));
  const keys: Record<string, string> = { l: "use-lamps", a: "use-ambient", t: "use-truth", r: "turn", f: "use-formulas", g: "use-ground" };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || (event.target as HTMLElement).matches("select, pre")) return;
    const box = keys[event.key.toLowerCase()];
    if (box) element<HTMLInputElement>(box).click();
  });
  canvas.addEventListener("keydown", (event) => {
    const step: Record<string, [number, number]> = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] };
    const move = step[event.key];
    if (!move) return;
    event.preventDefault();
    stage.azimuth += move[0];
    stage.elevation += move[1];
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    stage.azimuth -= event.movementX / 200;
    stage.elevation += event.movementY / 300;
  });
}

wire();
element("enter-room").addEventListener("click", () => void enterRoom());
void isXrOffered().then((is) => { element("enter-room").hidden = !is; });
// Lamps shine by themselves here: the map that metal and glass mirror is without them.
let asked = false;
probe.on("hello", ({ maxReflectionMapSize }) => {
  if (!asked && maxReflectionMapSize) probe.subscribe({ reflectionMap: { size: 32, rateHz: 2, kind: "AMBIENT" } });
  asked ||= maxReflectionMapSize > 0;
});
renderer.setAnimationLoop(frame);
