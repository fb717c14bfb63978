// SPDX-License-Identifier: Apache-2.0
/** Until when all that has arrived has also been read. */

/** So often a turn of the event loop is noted, and so many turns it takes until what waited before them has been read. */
const PERIOD_MS = 50, TURNS = 3;

/**
 * After a pause of the page (shaders are compiled, the tab sleeps) messages wait in the browser's queue, and the first frame may be
 * drawn before they are read. What is the newest by then says nothing of what the probe has sent. So age and silence are judged at
 * the last moment of which it is known that all that had come by then was read.
 */
export class Drained {
  #turnsMs: number[] = [];
  #timer: ReturnType<typeof setInterval> | undefined;
  readonly #now: () => number;

  /** `now`: a clock in milliseconds that nobody sets. */
  constructor(now: () => number) {
    this.#now = now;
  }

  /** Starts anew: as if all were read now. Before it, and after stop(), nothing is waited for. */
  start(): void {
    this.stop();
    this.#turnsMs = [this.#now()];
    this.#timer = setInterval(() => {
      this.#turnsMs.push(this.#now());
      if (this.#turnsMs.length > TURNS) this.#turnsMs.shift();
    }, PERIOD_MS);
  }

  stop(): void {
    clearInterval(this.#timer);
    this.#timer = undefined;
    this.#turnsMs = [];
  }

  /** All that came before this time of the clock has been read. */
  get untilMs(): number {
    return this.#turnsMs[0] ?? this.#now();
  }
}
