// SPDX-License-Identifier: Apache-2.0
/**
 * What keeps the user's last action from its aim, and what to do about it. It stays until an action succeeds or the user dismisses
 * it. What keeps the probe away has a place of its own (panel.ts).
 */

const element = (id: string): HTMLElement => document.getElementById(id)!;

export function say(problem: string): void {
  element("problem-text").textContent = problem;
  element("problem").hidden = false;
}

export function dismiss(): void {
  element("problem").hidden = true;
}

/** Work that is done sooner is not worth a word. */
const QUIET_MS = 500;

/** Says what the page does until it ends, and how far it is; what began last is what is shown. */
export function showWork(what: string): { show: (share: number) => void; end: () => void } {
  const line = element("work");
  const timer = setTimeout(() => { line.hidden = false; }, QUIET_MS);
  line.textContent = what;
  line.hidden = true;
  return {
    show: (share) => { line.textContent = `${what}: ${Math.floor(100 * share)} %`; },
    end: () => {
      clearTimeout(timer);
      line.hidden = true;
    },
  };
}
