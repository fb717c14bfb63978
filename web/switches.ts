// SPDX-License-Identifier: Apache-2.0
/** Switches of what may not be there, as a truth or a marker. */

const chosen = new Map<HTMLInputElement, boolean>();

/** While it is not there, its switch is off and its title says what is missing; then the user's choice comes back, at first on. */
export function offer(id: string, is: boolean, missing: string): void {
  const box = document.getElementById(id) as HTMLInputElement;
  if (is === box.disabled) {
    if (!is) chosen.set(box, box.checked);
    box.checked = is && (chosen.get(box) ?? true);
    box.disabled = !is;
  }
  box.labels![0]!.title = is ? "" : missing;
}
