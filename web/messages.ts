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
