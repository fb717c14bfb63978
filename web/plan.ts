// SPDX-License-Identifier: Apache-2.0
/** A plan of the room from above: the probe in the middle, its forward (−Z) up, lamps at their places, and the object that the user moves. */
import { besideSh } from "../src/index.js";
import type { Estimate, Light, Vec3 } from "../src/index.js";
import { screenColour } from "./panel.js";
import { MOST_M, cornersOf, halfWidthM, isPlaced, missingInWords, placeInWords, spotOf, type Spot } from "./places.js";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;

const STEP_M = 0.1, FINE_STEP_M = 0.01;
/** A finger this near to the object takes hold of it, in pixels of the page; elsewhere it scrolls the page. */
const GRIP_PX = 28;
const MARGIN_PX = 16, LAMP_PX = 8, OBJECT_PX = 13, ARROW_PX = 26;
const TEXT = "#e8e6e0", DIM = "#9aa0a8", GRID = "#23282f";

const write = (id: string, text: string): void => {
  const there = element(id); // written only when it is new, so that it is read out once
  if (there.textContent !== text) there.textContent = text;
  there.hidden = text === "";
};

export class Plan {
  readonly #canvas = element<HTMLCanvasElement>("plan");
  readonly #height = element<HTMLInputElement>("plan-height");
  readonly #context = this.#canvas.getContext("2d")!;
  #positionM: Vec3 = [0, 0, 0];
  #halfM = 2;
  #estimate: Estimate | undefined;
  #isHeld = false;

  constructor() {
    const canvas = this.#canvas;
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.#isNear(event)) return;
      this.#isHeld = true;
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("touchstart", (event) => { if (this.#isNear(event.touches[0]!)) event.preventDefault(); }, { passive: false });
    canvas.addEventListener("pointermove", (event) => { if (this.#isHeld) this.#moveTo(event); });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { this.#isHeld = false; });
    canvas.addEventListener("click", (event) => this.#moveTo(event));
    canvas.addEventListener("keydown", (event) => this.#onKey(event));
    this.#height.addEventListener("input", () => this.#move(this.#positionM[0], this.#positionM[2]));
  }

  /** Of the object: metres from the probe, in its axes. */
  get positionM(): Vec3 {
    return this.#positionM;
  }

  /** Draws the lamps of an estimate; undefined: there is none. The plan appears with the first distance or room, and stays. */
  show(estimate: Estimate | undefined): void {
    this.#estimate = estimate;
    if (estimate) write("plan-missing", missingInWords(estimate));
    if (isPlaced(estimate) || estimate?.room) element("plan-room").hidden = false;
    if (!element("plan-room").hidden) this.#draw();
  }

  // ---------------------------------------------------------------- the object

  /** Canvas pixels of a metre. */
  get #scale(): number {
    return (this.#canvas.width / 2 - MARGIN_PX) / this.#halfM;
  }

  #at(xM: number, zM: number): [number, number] {
    return [this.#canvas.width / 2 + this.#scale * xM, this.#canvas.height / 2 + this.#scale * zM];
  }

  /** Where the pointer is in the plan, in metres; and a pixel of the page in metres. */
  #pointed({ clientX, clientY }: { clientX: number; clientY: number }): [xM: number, zM: number, pixelM: number] {
    const box = this.#canvas.getBoundingClientRect(), pixelM = this.#canvas.width / box.width / this.#scale;
    return [(clientX - box.left - box.width / 2) * pixelM, (clientY - box.top - box.height / 2) * pixelM, pixelM];
  }

  #isNear(pointer: { clientX: number; clientY: number }): boolean {
    const [xM, zM, pixelM] = this.#pointed(pointer);
    return Math.hypot(xM - this.#positionM[0], zM - this.#positionM[2]) < GRIP_PX * pixelM;
  }

  #moveTo(pointer: { clientX: number; clientY: number }): void {
    const [xM, zM] = this.#pointed(pointer);
    const within = (value: number): number => Math.max(-this.#halfM, Math.min(this.#halfM, value));
    this.#move(within(xM), within(zM));
  }

  #onKey(event: KeyboardEvent): void {
    const step = event.shiftKey ? FINE_STEP_M : STEP_M, [x, , z] = this.#positionM;
    const places: Record<string, [number, number]> = {
      ArrowLeft: [x - step, z], ArrowRight: [x + step, z], ArrowUp: [x, z - step], ArrowDown: [x, z + step], Home: [0, 0],
    };
    const place = places[event.key];
    if (!place) return;
    event.preventDefault();
    this.#move(...place);
  }

  /** To whole centimetres; the height is what its field says. */
  #move(xM: number, zM: number): void {
    const whole = (value: number): number => Math.round(Math.max(-MOST_M, Math.min(MOST_M, value)) * 100) / 100;
    this.#positionM = [whole(xM), whole(this.#height.valueAsNumber || 0), whole(zM)];
    write("plan-place", placeInWords(this.#positionM));
    this.#draw();
  }

  // ---------------------------------------------------------------- the picture

  #draw(): void {
    const { width, height } = this.#canvas, lights = besideSh(this.#estimate);
    const spots = lights.map(spotOf).filter((spot) => spot !== undefined);
    const room = this.#estimate?.room, corners = room ? cornersOf(room) : [];
    if (!this.#isHeld) this.#halfM = halfWidthM(spots, this.#positionM, this.#halfM, corners); // no other scale under the finger
    const isInside = (spot: Spot): boolean => Math.hypot(spot.xM, spot.zM) <= this.#halfM;
    this.#context.clearRect(0, 0, width, height);
    this.#context.font = "24px system-ui, sans-serif";
    this.#drawGrid();
    if (room) this.#drawRoom(corners);
    this.#drawProbe();
    for (const light of lights) {
      const spot = spotOf(light);
      if (spot && isInside(spot)) this.#drawLamp(spot);
      else this.#drawArrow(light);
    }
    this.#drawObject();
  }

  #line(...points: [number, number][]): void {
    this.#context.beginPath();
    for (const point of points) this.#context.lineTo(...point);
    this.#context.stroke();
  }

  /** Lines a metre apart, or half a metre in a small plan, and how far that is. */
  #drawGrid(): void {
    const context = this.#context, gapM = this.#halfM <= 2 ? 0.5 : this.#halfM <= 5 ? 1 : 2, count = Math.floor(this.#halfM / gapM), { width, height } = this.#canvas;
    [context.strokeStyle, context.lineWidth] = [GRID, 2];
    for (let i = -count; i <= count; i++) {
      const [x, y] = this.#at(i * gapM, i * gapM);
      this.#line([x, 0], [x, height]);
      this.#line([0, y], [width, y]);
    }
    const left = MARGIN_PX, low = height - MARGIN_PX, right = left + gapM * this.#scale;
    context.strokeStyle = context.fillStyle = DIM;
    this.#line([left, low - 8], [left, low], [right, low], [right, low - 8]);
    context.fillText(`${gapM} m`, left + 8, low - 8);
  }

  /** The walls, as the box that the probe takes the room for. */
  #drawRoom(corners: [xM: number, zM: number][]): void {
    [this.#context.strokeStyle, this.#context.lineWidth] = [DIM, 3];
    this.#line(...[...corners, corners[0]!].map(([xM, zM]) => this.#at(xM, zM)));
  }

  /** A wedge that points forward. */
  #drawProbe(): void {
    const context = this.#context, [x, y] = this.#at(0, 0);
    [context.fillStyle, context.lineWidth] = [DIM, 2];
    context.beginPath();
    for (const [right, down] of [[0, -18], [11, 12], [0, 6], [-11, 12]] as const) context.lineTo(x + right, y + down);
    context.fill();
    context.fillText("probe", x + 16, y + 24);
  }

  /** A lamp, 1 sigma of its place, and its distance. */
  #drawLamp({ light, xM, zM, alongM, acrossM }: Spot): void {
    const context = this.#context, [x, y] = this.#at(xM, zM), [along, across] = [alongM * this.#scale, acrossM * this.#scale];
    context.fillStyle = colourOf(light);
    context.beginPath();
    context.arc(x, y, LAMP_PX, 0, 2 * Math.PI);
    context.fill();
    if (Math.max(along, across) > LAMP_PX) {
      [context.strokeStyle, context.lineWidth] = [TEXT, 3];
      context.setLineDash([5, 5]);
      context.beginPath();
      context.ellipse(x, y, along, across, Math.atan2(zM, xM), 0, 2 * Math.PI);
      context.stroke();
      context.setLineDash([]);
    }
    const sigmaM = light.distanceSigma === undefined ? "" : ` ± ${(light.distanceM! * light.distanceSigma).toFixed(2)}`;
    this.#label(`${light.id || "KEY"}: ${light.distanceM!.toFixed(2)}${sigmaM} m`, x, y - LAMP_PX - 8);
  }

  /** A lamp that is too far away for the plan, or of which only the direction is known. */
  #drawArrow(light: Light): void {
    const context = this.#context, { width, height } = this.#canvas, [dx, , dz] = light.direction, level = Math.hypot(dx, dz) || 1;
    const radius = width / 2 - MARGIN_PX, x = width / 2 + (radius * dx) / level, y = height / 2 + (radius * dz) / level;
    const corner = (back: number, side: number): [number, number] => [x - (back * dx - side * dz) / level, y - (back * dz + side * dx) / level];
    context.fillStyle = colourOf(light);
    context.beginPath();
    for (const point of [[x, y] as const, corner(ARROW_PX, ARROW_PX / 3), corner(ARROW_PX, -ARROW_PX / 3)]) context.lineTo(...point);
    context.fill();
    const far = light.distanceM !== undefined ? `: ${light.distanceM.toFixed(1)} m` : light.nearestM !== undefined ? `: ≥ ${light.nearestM.toFixed(1)} m` : ": ?";
    const text = `${light.id || "KEY"}${far}`, wide = context.measureText(text).width;
    const [inwardX, inwardY] = corner(ARROW_PX + 16 + (wide / 2) * Math.abs(dx / level), 0);
    this.#label(text, inwardX, inwardY + 8);
  }

  /** Text whose baseline has its middle at a point, moved into the plan. */
  #label(text: string, x: number, y: number): void {
    const context = this.#context, wide = context.measureText(text).width;
    context.fillStyle = DIM;
    context.fillText(text, Math.max(4, Math.min(this.#canvas.width - wide - 4, x - wide / 2)), Math.max(24, y));
  }

  #drawObject(): void {
    const context = this.#context, [x, y] = this.#at(this.#positionM[0], this.#positionM[2]);
    [context.strokeStyle, context.lineWidth] = [TEXT, 4];
    context.strokeRect(x - OBJECT_PX, y - OBJECT_PX, 2 * OBJECT_PX, 2 * OBJECT_PX);
  }
}

const colourOf = (light: Light): string => screenColour(light.irradiance, 1 / Math.max(...light.irradiance, 1e-9));
