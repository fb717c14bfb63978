// SPDX-License-Identifier: Apache-2.0
/**
 * The viewer: objects in the light of the probe that serves this page, and beside them in the true light when a simulator
 * gives it. In the address: ?probe=ws://… another probe, ?truth=ws://… the truth, ?fov=DEGREES the field of the device's camera.
 */
import { Probe, fallbackEstimate, irradiance, luminance } from "../src/index.js";
import type { Estimate, ProbeOptions, ReflectionMapWish, Vec3 } from "../src/index.js";
import { dismiss, say } from "./messages.js";
import { show } from "./panel.js";
import { Mirrored, isPlaced, lightThere } from "./places.js";
import { Plan } from "./plan.js";
import { offer } from "./switches.js";
import { MOST_LAMPS, View, type Seen } from "./view.js";
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
const probe = open(address.searchParams.get("probe") ?? location.href, { shOrder: ORDER, maxLights: MOST_LAMPS });
const truthAddress = address.searchParams.get("truth");
const truth = truthAddress ? open(truthAddress, { shOrder: ORDER, maxLights: 8, healthPeriodMs: 0 }) : undefined;

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
probe.on("estimate", (estimate) => { [last, fallback] = [estimate, undefined]; });

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

function seen(): Seen {
  const known = there(probe), exact = checked("use-truth") && truth ? there(truth) : undefined;
  const estimate = known ?? (fallback ??= fallbackEstimate(last)), whole = checked("use-ambient") && checked("use-lamps");
  const here = probe.latest(), map = here && whole && usesMap() ? probe.reflectionMap : undefined;
  return {
    estimate, isOfProbe: known !== undefined, shown: switched(estimate), truth: exact && switched(exact),
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
  show(probe, estimate, there(probe), exact, errorAgainst(estimate, exact), last !== undefined);
  plan.show(estimate);
  const isElsewhere = isPlaced(estimate) && !isPlaced(exact) && plan.positionM.some((value) => value !== 0);
  element("right").textContent = isElsewhere ? "lit by the truth at the probe" : "lit by the truth";
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
  dismiss();
}

function wirePicture(picture: View): void {
  element("behind").addEventListener("change", () => void showBehind(picture));
  element("enter-room").addEventListener("click", () => {
    element<HTMLSelectElement>("behind").value = "room";
    void attempt(() => picture.enterRoom(), "AR", "allow this page to use the device's sensors, and open it by https: or on this machine");
  });
  void isXrOffered().then((is) => { element("enter-room").hidden = !is; });
  element<HTMLInputElement>("object").addEventListener("change", (event) => {
    const file = (event.target as HTMLInputElement).files?.[0];
    if (file) void attempt(() => picture.stage.load(file), file.name, "choose a .glb file that holds all it needs");
  });
  element("use-formulas").addEventListener("change", () => picture.stage.useFormulas(checked("use-formulas")));
  const canvas = element<HTMLCanvasElement>("view");
  canvas.addEventListener("keydown", (event) => {
    const step: Record<string, [number, number]> = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.05], ArrowDown: [0, -0.05] };
    const move = step[event.key];
    if (!move) return;
    event.preventDefault();
    picture.stage.azimuth += move[0];
    picture.stage.elevation += move[1];
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) return;
    picture.stage.azimuth -= event.movementX / 200;
    picture.stage.elevation += event.movementY / 300;
  });
}

function subscribe(): void {
  probe.subscribe({
    shOrder: Number(chosen("order")), maxLights: Number(chosen("lights")), tolerance: Number(chosen("tolerance")), keyLight: checked("use-key"),
    reflectionMap: usesMap() ? MAP : undefined,
  });
}

function wireWishes(): void {
  for (const id of ["order", "lights", "tolerance", "use-key", "use-map"]) element(id).addEventListener("change", subscribe);
  let had = false;
  probe.on("hello", ({ maxReflectionMapSize }) => {
    const has = view !== undefined && maxReflectionMapSize > 0;
    offer("use-map", has, "This probe sends none: its owner can start lightprobed with --reflection-map=32");
    if (has !== had) subscribe();
    had = has;
  });
}

const KEYS: Record<string, string> = { l: "use-lamps", a: "use-ambient", t: "use-truth", r: "turn", f: "use-formulas", g: "use-ground", k: "use-key", m: "use-map" };

function wireKeys(): void {
  addEventListener("keydown", (event) => {
    if (event.key === "Escape") return dismiss();
    if (event.ctrlKey || event.metaKey || event.altKey || (event.target as HTMLElement).matches("select, pre")) return;
    const box = KEYS[event.key.toLowerCase()];
    if (box) element<HTMLInputElement>(box).click();
  });
}

document.querySelector<HTMLElement>("#legend .truth")!.hidden = !truth;
offer("use-truth", truth !== undefined, "Only a simulator knows it: ?truth=ws://… in the address, as make demo does");
element("dismiss").addEventListener("click", dismiss);
const view = makeView();
if (view) wirePicture(view);
wireWishes();
wireKeys();
setInterval(showFigures, PANEL_PERIOD_MS);
