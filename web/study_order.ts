// SPDX-License-Identifier: Apache-2.0
/** In what order a participant sees the trials of a study, and what is left or on top: by a seed alone. */

export interface Trial { id: string; kind: "rating" | "choice"; pictures: string[]; asked?: number }

/** A trial as it is shown: `swapped`: the second picture is left or on top. */
export interface Turn { trial: Trial; swapped: boolean }

/** Numbers from 0 to below 1 by a seed of 32 bits: splitmix32, after G. L. Steele et al., OOPSLA 2014. */
export function random(seed: number): () => number {
  let state = seed >>> 0;
  return () => {
    state = (state + 0x9e3779b9) >>> 0;
    let z = state;
    z = Math.imul(z ^ (z >>> 16), 0x21f0aaad);
    z = Math.imul(z ^ (z >>> 15), 0x735a2d97);
    return ((z ^ (z >>> 15)) >>> 0) / 2 ** 32;
  };
}

/** Fisher and Yates. */
function shuffled<T>(items: readonly T[], next: () => number): T[] {
  const out = [...items];
  for (let k = out.length - 1; k > 0; k--) {
    const other = Math.floor(next() * (k + 1));
    [out[k], out[other]] = [out[other]!, out[k]!];
  }
  return out;
}

/** How often neighbours show the same picture: as seldom as can be, so that nobody remembers what was said a moment ago. */
function neighbours(trials: readonly Trial[]): number {
  return trials.filter((one, k) => k > 0 && one.pictures.some((picture) => trials[k - 1]!.pictures.includes(picture))).length;
}

const TRIES = 100;

/** The best of some random orders: where pictures are few, the same one may still come twice in a row. */
function spread(trials: readonly Trial[], next: () => number): Trial[] {
  let best = shuffled(trials, next);
  for (let k = 1; k < TRIES && neighbours(best) > 0; k++) {
    const other = shuffled(trials, next);
    if (neighbours(other) < neighbours(best)) best = other;
  }
  return best;
}

/**
 * All trials in random order, ratings before choices, because a choice shows the real object beside the other.
 * Half of the choices are swapped, and a pair that comes again is shown the other way round. The pairs that are compared are halved
 * by themselves: those that come once, and those that come twice. (The page is not told which of two is the repeated one.)
 */
export function turns(trials: readonly Trial[], seed: number): Turn[] {
  const next = random(seed);
  const of = (kind: Trial["kind"]): Trial[] => spread(trials.filter((one) => one.kind === kind), next);
  const ratings = of("rating").map((trial) => ({ trial, swapped: false }));
  const groups = new Map<string, Trial[]>();
  const choices = of("choice");
  for (const trial of choices) {
    const key = JSON.stringify(trial.pictures);
    groups.set(key, [...(groups.get(key) ?? []), trial]);
  }
  const rated = new Set(ratings.flatMap(({ trial }) => trial.pictures));
  // Of a catch trial one picture is upside down, and such a one is not rated. Without ratings, catch trials are halved with the others.
  const isCompared = ({ pictures }: Trial): boolean => pictures[0] !== pictures[1] && (rated.size === 0 || pictures.every((one) => rated.has(one)));
  const rank = (group: Trial[]): number => (isCompared(group[0]!) ? Math.min(group.length, 2) : 3);
  const swapped = new Set<Trial>(), inTurn = shuffled([...groups.values()], next).sort((a, b) => rank(a) - rank(b)).flat();
  // One after the other, in random order of the pairs: every second one of all is swapped, and so of each sort and of each pair.
  // Where their number is odd, chance says of what there is one more.
  const first = next() < 0.5 ? 0 : 1;
  inTurn.forEach((trial, k) => { if (k % 2 !== first) swapped.add(trial); });
  return [...ratings, ...choices.map((trial) => ({ trial, swapped: swapped.has(trial) }))];
}
