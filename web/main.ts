// SPDX-License-Identifier: Apache-2.0
/**
 * The viewer: objects in the light of the probe that serves this page, and beside them in the true light when a simulator
 * gives it. In the address: ?probe=ws://… another probe, ?truth=ws://… the truth, ?fov=DEGREES the field of the device's camera.
 */
import { isTruthShown, comparedAt, wireComparison } from "./compare.js";
import { kindOf, wireFiles } from "./files.js";
import { Probe, fallbackEstimate, irradiance, luminance } from "../src/index.js";
import type { Estimate, ProbeOptions, ReflectionMapWish, Vec3 } from "../src/index.js";
import { dismiss, say, showWork } from "./messages.js";
import { show } from "./panel.js";
import { Mirrored, isPlaced, lightThere } from "./places.js";
import { mainLightAndAmbient } from "./plain_light.js";
import { Plan } from "./plan.js";
import { readInWorker } from "./reading.js";
import { checkSize, type Recorded } from "./recording.js";
import { replayed } from "./replay.js";
import type { Behind, What } from "./scene.js";
import { wireShading } from "./shading_panel.js";
import { wirePointers } from "./pointers.js";
import { offer } from "./switches.js";
import { MOST_LAMPS, View, type Other, type Seen } from "./view.js";
import { isXrOffered } from "./xr.js";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const checked = (id: string): boolean => element<HTMLInputElement>(id).checked;
const chosen = (id: string): string => element<HTMLSelectElement>(id).value;

const PANEL_PERIOD_MS = 200;
/** Lamps shine by themselves here: the map that metal and glass mirror is without them. */
const MAP: ReflectionMapWish = { size: 32, rateHz: 2, kind: "AMBIENT" };
/** Phones see about so much along the longer side of their picture. */
const FIELD_DEG = 65;

const address = new URL(location.href);
/** The highest: moved to where the object stands, ambient light of order 2 keeps a third of its error, of order 4 a tenth. */
const ORDER = 4;
let probe = open(address.searchParams.get("probe") ?? location.href, { shOrder: ORDER, maxLights: MOST_LAMPS });
const truthAddress = address.searchParams.get("truth");
/** None while a recording plays: what the simulator shows now is not what lit it. */
let truth = truthAddress ? open(truthAddress, { shOrder: ORDER, maxLights: 8, healthPeriodMs: 0 }) : undefined;

/** The client of an address; where that is none, as one with a token and without TLS, the page says so and ends. */
function open(where: string, options: ProbeOptions): Probe {
  try {
    return new Probe(where, options);
  } catch (error) {
    say((error as Error).message);
    throw error;
  }
}

let last: Estimate | undefined, fallback: Estimate | undefined;
/** Name of the recording that is played. */
let recording: string | undefined;

const plan = new Plan(), mirrored = new Mirrored();

/** The newest light of a probe where the object stands. */
function there(of: Probe): Estimate | undefined {
  const estimate = of.latest();
  return estimate && lightThere(estimate, plan.positionM);
}

/** What the switches leave of an estimate. */
function switched(estimate: Estimate): Estimate {
  return {
    ...estimate,
    ...(checked("use-lamps") ? {} : { lights: [], key: undefined }),
    sh: checked("use-ambient") ? estimate.sh : { ...estimate.sh, coefficients: estimate.sh.coefficients.map(() => 0) },
  };
}

const usesMap = (): boolean => view !== undefined && checked("use-map") && Boolean(probe.hello?.maxReflectionMapSize);

/** The light to compare with, where one is chosen; `shown`: what the switches leave of the probe's. */
function compared(shown: Estimate): Other | undefined {
  const splitAt = comparedAt(), exact = isTruthShown() && truth ? there(truth) : undefined;
  if (splitAt !== undefined) return { estimate: mainLightAndAmbient(shown), splitAt };
  return exact && { estimate: switched(exact), splitAt: undefined };
}

function seen(): Seen {
  const known = there(probe), estimate = known ?? (fallback ??= fallbackEstimate(last)), shown = switched(estimate), whole = checked("use-ambient") && checked("use-lamps");
  const here = probe.latest(), map = here && whole && usesMap() ? probe.reflectionMap : undefined;
  return {
    estimate, isOfProbe: known !== undefined, shown, other: compared(shown),
    map: here && map && mirrored.at(map, here, plan.positionM), mapOfProbe: map, turns: checked("turn"), mirrorsGround: checked("use-ground"),
  };
}

function makeView(): View | undefined {
  try {
    return new View(element("view"), Number(address.searchParams.get("fov") ?? FIELD_DEG), seen);
  } catch (error) {
    console.warn(`picture: ${String(error)}`);
    say("This browser has no WebGL 2, which the picture needs: try another browser, or switch on its hardware acceleration. The map, the lamps and the figures work without.");
    element<HTMLFieldSetElement>("picture").disabled = true;
    element("labels").hidden = element("view").hidden = true;
    return undefined;
  }
}

// ---------------------------------------------------------------- figures

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

function showFigures(): void {
  const estimate = probe.latest(), exact = truth?.latest();
  show(probe, { estimate, there: there(probe), truth: exact, errorOfTruth: errorAgainst(estimate, exact), had: last !== undefined, recording });
  plan.show(estimate);
  const isElsewhere = isPlaced(estimate) && !isPlaced(exact) && plan.positionM.some((value) => value !== 0), of = isElsewhere ? "the truth at the probe" : "the truth";
  element("right").textContent = comparedAt() === undefined ? `lit by ${of}` : "one main light and ambient";
  offer("use-ground", Boolean(view?.isOnMarker), "Needs a marker in the camera picture: choose it under Behind");
}

// ---------------------------------------------------------------- switches

/** Do what the user asks for, and say what is in its way, if something is. */
async function attempt(action: () => Promise<void>, what: string, advice: string): Promise<boolean> {
  try {
    await action();
    dismiss();
    return true;
  } catch (error) {
    say(`${what}: ${String(error)}: ${advice}`);
    return false;
  }
}

async function showBehind(picture: View): Promise<void> {
  if (chosen("behind") === "camera") {
    if (!(await attempt(() => picture.showCamera(), "camera", "allow this page to use a camera, and open it by https: or on this machine")))
      element<HTMLSelectElement>("behind").value = "room";
    return;
  }
  picture.hideCamera();
  picture.stage.behind = chosen("behind") as Behind;
  dismiss();
}

/** Shows what is in a file: an object, or a recording in place of the probe. */
async function openFile(file: File): Promise<void> {
  const show = async (): Promise<void> => {
    if (kindOf(file.name) === "recording") {
      checkSize(file.size);
      return playFile(file);
    }
    if (!view) throw new Error("this browser has no WebGL 2, which the picture needs");
    await view.stage.load(file);
    element<HTMLOptionElement>("scene-loaded").hidden = false;
    element<HTMLSelectElement>("scene").value = "loaded";
  };
  await attempt(show, file.name, /\.mcap$/i.test(file.name) ? "the probe's light stays" : "choose a .glb file that holds all it needs");
}

function wirePicture(picture: View): void {
  element("behind").addEventListener("change", () => void showBehind(picture));
  element("enter-room").addEventListener("click", () => {
    element<HTMLSelectElement>("behind").value = "room";
    void attempt(() => picture.enterRoom(), "AR", "allow this page to use the device's sensors, and open it by https: or on this machine");
  });
  void isXrOffered().then((is) => { element("enter-room").hidden = !is; });
  element("scene").addEventListener("change", () => picture.stage.show(chosen("scene") as What));
  element("use-formulas").addEventListener("change", () => picture.stage.useFormulas(checked("use-formulas")));
  wireShading((term, settings) => picture.stage.setTerm(term, settings));
  const canvas = element<HTMLCanvasElement>("view");
  canvas.addEventListener("keydown", (event) => {
    if (event.key === "+" || event.key === "-") picture.stage.nearer(event.key === "+" ? 1 : -1);
    const step: Record<string, [number, number]> = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] };
    const move = step[event.key];
    if (!move) return;
    event.preventDefault();
    picture.stage.azimuth += move[0];
    picture.stage.elevation += move[1];
  });
  wirePointers(canvas, picture.stage);
}

function subscribe(): void {
  probe.subscribe({
    shOrder: Number(chosen("order")), maxLights: Number(chosen("lights")), tolerance: Number(chosen("tolerance")), keyLight: checked("use-key"),
    reflectionMap: usesMap() ? MAP : undefined,
  });
}

let hadMaps = false;

/** The page follows this probe from now on. */
function follow(): void {
  [last, fallback] = [undefined, undefined];
  probe.on("estimate", (estimate) => { [last, fallback] = [estimate, undefined]; });
  probe.on("hello", ({ maxReflectionMapSize }) => {
    const has = view !== undefined && maxReflectionMapSize > 0;
    offer("use-map", has, "This probe sends none: its owner can start lightprobed with --reflection-map=32");
    if (has !== hadMaps) subscribe();
    hadMaps = has;
  });
}

/** Plays a recording, once it is read, unless another file is opened before; throws what keeps it from it. */
async function playFile(file: File): Promise<void> {
  const work = showWork(`${file.name}: reading the recording`);
  try {
    const recorded = await readInWorker(file, work.show);
    if (recorded) play(file.name, recorded);
  } finally {
    work.end();
  }
}

/** Plays messages in place of the probe. What was asked for when they were recorded is what there is. */
function play(name: string, recorded: Recorded[]): void {
  const socket = replayed(recorded);
  probe.close();
  [recording, hadMaps] = [name, false];
  probe = new Probe("ws://recording/", { WebSocket: socket });
  follow();
  element<HTMLFieldSetElement>("wishes").disabled = true;
  truth?.close();
  truth = undefined;
  offerTruth("A recording has no truth beside it: reload the page for the live light");
}

/** The switch, and the crosses' place in the legend of the map. */
function offerTruth(missing: string): void {
  document.querySelector<HTMLElement>("#legend .truth")!.hidden = !truth;
  offer("use-truth", truth !== undefined, missing);
}

function wireWishes(): void {
  for (const id of ["order", "lights", "tolerance", "use-key", "use-map"]) element(id).addEventListener("change", subscribe);
  follow();
}

const KEYS: Record<string, string> = { l: "use-lamps", a: "use-ambient", t: "use-truth", r: "turn", f: "use-formulas", g: "use-ground", k: "use-key", m: "use-map", b: "use-main" };

function wireKeys(): void {
  addEventListener("keydown", (event) => {
    if (event.key === "Escape") return dismiss();
    if (event.ctrlKey || event.metaKey || event.altKey || (event.target as HTMLElement).matches("select, pre, input[type=number]")) return;
    const box = KEYS[event.key.toLowerCase()];
    if (box) element<HTMLInputElement>(box).click();
  });
}

offerTruth("Only a simulator knows it: ?truth=ws://… in the address, as make demo does");
element("dismiss").addEventListener("click", dismiss);
const view = makeView();
if (view) wirePicture(view);
wireComparison();
wireFiles((file) => void openFile(file));
wireWishes();
wireKeys();
setInterval(showFigures, PANEL_PERIOD_MS);
