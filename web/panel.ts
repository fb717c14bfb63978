// SPDX-License-Identifier: Apache-2.0
/** What stands beside the picture: a map of all directions, lamps, figures, spherical harmonics, faults. */
import { LightFlag, besideSh, flagNames, luminance, meanIrradiance, sh } from "../src/index.js";
import type { Estimate, Light, Probe, Vec3 } from "../src/index.js";
import { FLAG_WORDS } from "../src/gen/flag_words.js";
import { statusOf } from "./waiting.js";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
const DEG = 180 / Math.PI;
const CELLS = 64;

export const azimuthDeg = ([x, , z]: Vec3): number => Math.atan2(x, -z) * DEG;
export const elevationDeg = ([, y]: Vec3): number => Math.asin(Math.max(-1, Math.min(1, y))) * DEG;

/** Colour on the screen of linear light: three bytes. */
function encode(rgb: ArrayLike<number>, scale: number): number[] {
  return Array.from(rgb).map((value) => Math.round(255 * Math.min(1, Math.max(0, value * scale)) ** (1 / 2.2)));
}

/** The same as CSS has it. */
export const screenColour = (rgb: ArrayLike<number>, scale: number): string => `rgb(${encode(rgb, scale).join(" ")})`;

export function drawMap(estimate: Estimate | undefined, truth: Estimate | undefined): void {
  const canvas = element<HTMLCanvasElement>("map"), context = canvas.getContext("2d")!;
  const { width, height } = canvas;
  context.clearRect(0, 0, width, height);
  if (!estimate) return;
  const scale = 0.35 / Math.max(1e-9, meanIrradiance({ ...estimate, lights: [] }) / Math.PI);
  const cells = new ImageData(CELLS, CELLS / 2);
  for (let row = 0; row < CELLS / 2; row++)
    for (let column = 0; column < CELLS; column++) {
      const theta = (Math.PI * (row + 0.5)) / (CELLS / 2), lambda = 2 * Math.PI * ((column + 0.5) / CELLS - 0.5);
      const d: Vec3 = [Math.sin(theta) * Math.sin(lambda), Math.cos(theta), -Math.sin(theta) * Math.cos(lambda)];
      cells.data.set([...encode(sh.radiance(estimate.sh.coefficients, d), scale), 255], 4 * (row * CELLS + column));
    }
  const small = new OffscreenCanvas(CELLS, CELLS / 2);
  small.getContext("2d")!.putImageData(cells, 0, 0);
  context.drawImage(small, 0, 0, width, height);
  const at = (d: Vec3): [number, number] => [(azimuthDeg(d) / 360 + 0.5) * width, (0.5 - elevationDeg(d) / 180) * height];
  const round = (light: Light, radiusDeg: number): void => {
    const [x, y] = at(light.direction);
    const stretch = 1 / Math.max(0.05, Math.hypot(light.direction[0], light.direction[2]));
    for (const shift of [-width, 0, width]) { // across the seam
      context.beginPath();
      context.ellipse(x + shift, y, Math.min(width, (radiusDeg * stretch * width) / 360), (radiusDeg * height) / 180, 0, 0, 2 * Math.PI);
      context.stroke();
    }
  };
  context.lineWidth = 3;
  for (const light of besideSh(estimate)) {
    context.strokeStyle = "#ffd479";
    round(light, Math.max(light.angularRadiusDeg, 2));
    if (light.directionSigmaDeg === undefined || light.directionSigmaDeg < 0.3) continue; // too small to see
    context.setLineDash([5, 5]);
    context.strokeStyle = "#e8e6e0";
    round(light, Math.max(light.angularRadiusDeg, 2) + light.directionSigmaDeg);
    context.setLineDash([]);
  }
  context.strokeStyle = "#7fd0ff";
  for (const light of truth?.lights ?? []) {
    const [x, y] = at(light.direction);
    context.beginPath();
    context.moveTo(x - 9, y - 9); context.lineTo(x + 9, y + 9); context.moveTo(x - 9, y + 9); context.lineTo(x + 9, y - 9);
    context.stroke();
  }
}

const number = (value: number, digits = 0): string => value.toFixed(digits);

function drawLamps(estimate: Estimate | undefined): void {
  const rows = besideSh(estimate).map((light) => {
    const row = document.createElement("tr");
    row.title = flagNames(light.flags, LightFlag).map(inWords).join("\n");
    const swatch = document.createElement("span");
    swatch.className = "swatch";
    swatch.style.background = screenColour(light.irradiance, 1 / Math.max(...light.irradiance, 1e-9));
    const sigma = light.directionSigmaDeg === undefined ? "" : ` ± ${number(light.directionSigmaDeg, 2)}`;
    const cells = ["", `${number(azimuthDeg(light.direction))}°`, `${number(elevationDeg(light.direction))}°${sigma}`, `${number(light.angularRadiusDeg, 1)}°`,
      light.distanceM === undefined ? "–" : `${number(light.distanceM, 2)} m`, `${luminance(light.irradiance).toPrecision(3)}${light.flags & LightFlag.CLIPPED ? " ≥" : ""}`];
    for (const [i, text] of cells.entries()) {
      const cell = row.insertCell();
      if (i === 0) cell.append(swatch, ` ${light.id || "KEY"}`);
      else cell.textContent = text;
    }
    return row;
  });
  document.querySelector("#lamps tbody")!.replaceChildren(...rows);
}

function drawFigures(figures: Record<string, string>): void {
  element("figures").replaceChildren(...Object.entries(figures).flatMap(([name, value]) => {
    const term = document.createElement("dt"), text = document.createElement("dd");
    term.textContent = name;
    text.textContent = value;
    return [term, text];
  }));
}

/** A flag, and what to do where something can be done. */
const inWords = (name: string): string => `${name}: ${FLAG_WORDS[name] ?? "unknown to this version"}`;

/** Written only when they are new. */
function showFaults(lines: string[]): void {
  const list = element("faults");
  if ([...list.children].map((item) => item.textContent).join("\n") === lines.join("\n")) return;
  list.replaceChildren(...lines.map((line) => Object.assign(document.createElement("li"), { textContent: line })));
}

/** What keeps the probe away; written only when it is new, so that it is read out once. */
function showConnection(problem: string): void {
  const connection = element("connection");
  connection.hidden = problem === "";
  if (connection.textContent !== problem) connection.textContent = problem;
}

/** Under the picture: whose light it is. `had`: light has come before. */
function showStatus(probe: Probe, had: boolean, recording: string | undefined): void {
  const status = element("status"), left = element("left"), text = recording === undefined ? statusOf(probe, had) : `recording ${recording}`;
  const label = probe.latest() ? (recording === undefined ? "lit by the probe" : "lit by the recording") : `not the room's light: ${text}`;
  if (status.textContent !== text) status.textContent = text;
  if (left.textContent !== label) left.textContent = label;
  status.classList.toggle("bad", probe.state === "waiting" || probe.state === "closed");
}

/** What is shown of a probe's light. */
export interface Shown {
  estimate: Estimate | undefined;
  /** The light where the object stands. */
  there: Estimate | undefined;
  truth: Estimate | undefined;
  /** Mean error of the light on a white sphere, as a share of its brightest point; undefined: no truth. */
  errorOfTruth: number | undefined;
  /** Light has come before. */
  had: boolean;
  /** Name of the file that is played; undefined: it is live. */
  recording: string | undefined;
}

export function show(probe: Probe, { estimate, there, truth, errorOfTruth, had, recording }: Shown): void {
  showStatus(probe, had, recording);
  drawMap(estimate, truth);
  drawLamps(estimate);
  const { health, hello } = probe;
  const figures: Record<string, string> = {};
  if (estimate) {
    figures["age of the light"] = `${number(probe.ageMs() ?? 0)} ms`;
    figures["in the probe"] = `${number(estimate.sendDelayMs)} ms`;
    if (estimate.predictedError !== undefined) figures["model leaves out"] = `${number(100 * estimate.predictedError, 1)} %`;
    figures["exposures"] = String(estimate.exposureCount);
    if (there && there !== estimate) figures["light at the object"] = `${number(meanIrradiance(there) / Math.max(1e-9, meanIrradiance(estimate)), 2)} × at the probe`;
    if (estimate.wheelDeg !== undefined) figures["polarizer"] = `${number(estimate.wheelDeg)}°`;
  }
  if (errorOfTruth !== undefined) figures["error on a white sphere"] = `${number(100 * errorOfTruth, 1)} %`;
  if (health) {
    figures["estimates"] = `${number(health.estimatesPerS, 1)} / s`;
    figures["latency p50, p99"] = `${number(health.latencyP50Us / 1000, 1)}, ${number(health.latencyP99Us / 1000, 1)} ms`;
    figures["processor"] = `${number(health.cpuPercent)} %`;
  }
  if (hello) figures["source, preset"] = `${hello.source}, ${health?.preset ?? hello.preset}`;
  drawFigures(figures);
  element("sh").textContent = (estimate?.sh.coefficients ?? []).reduce((text, value, i) => `${text}${value.toFixed(4).padStart(9)}${i % 3 === 2 ? "\n" : ""}`, "");
  showFaults([...(health?.faults ?? []).map(({ id, text }) => `${id}: ${text}`), ...flagNames(estimate?.flags ?? 0).map(inWords)]);
  showConnection(probe.state === "open" ? "" : probe.lastError ?? "");
}
