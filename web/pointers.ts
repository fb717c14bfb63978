// SPDX-License-Identifier: Apache-2.0
/** Turns the view by dragging, and brings it nearer by the wheel or two fingers. */
import type { Stage } from "./scene.js";

const AROUND_PER_PX = 1 / 200, UP_PER_PX = 1 / 300;
/** Pixels of the wheel, and the spread of two fingers as a logarithm, for one step nearer. */
const WHEEL_PX = 100, PINCH_STEPS = 1 / Math.log(1 / 0.9);

export function wirePointers(canvas: HTMLCanvasElement, stage: Stage): void {
  const down = new Map<number, { x: number; y: number }>();
  const spread = (): number => {
    const [a, b] = [...down.values()];
    return a && b ? Math.hypot(a.x - b.x, a.y - b.y) : 0;
  };
  canvas.addEventListener("pointerdown", (event) => {
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    canvas.setPointerCapture(event.pointerId);
  });
  for (const end of ["pointerup", "pointercancel"] as const) canvas.addEventListener(end, (event) => { down.delete(event.pointerId); });
  canvas.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before) return;
    const wide = spread();
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
    if (wide > 0) return stage.nearer(PINCH_STEPS * Math.log(Math.max(1, spread()) / wide));
    stage.azimuth -= (event.clientX - before.x) * AROUND_PER_PX;
    stage.elevation += (event.clientY - before.y) * UP_PER_PX;
  });
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    stage.nearer(-event.deltaY / WHEEL_PX);
  }, { passive: false });
}
