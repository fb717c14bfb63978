// SPDX-License-Identifier: Apache-2.0
/** What the picture is compared with: the truth beside it, or one main light and ambient light behind a line that the user moves; one at a time. */

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;
/** As wide as style.css makes it: the line is at its middle. */
const THUMB_PX = 40;

const boxes = [element<HTMLInputElement>("use-truth"), element<HTMLInputElement>("use-main")] as const;
const [truth, main] = boxes, split = element<HTMLInputElement>("split");

/** Where the line is, 0…1 from the left of the picture. */
function splitAt(): number {
  const width = split.clientWidth || 1, share = split.valueAsNumber / 100;
  return (THUMB_PX / 2 + share * (width - THUMB_PX)) / width;
}

function show(): void {
  split.hidden = element("line").hidden = !main.checked;
  const labels = element("labels").style;
  if (main.checked) labels.setProperty("--split", `${100 * splitAt()}%`);
  else labels.removeProperty("--split");
  element("line").style.left = `${100 * splitAt()}%`;
}

/** The line's place while the objects are compared with one main light and ambient light. */
export const comparedAt = (): number | undefined => (main.checked ? splitAt() : undefined);

export const isTruthShown = (): boolean => truth.checked;

export function wireComparison(): void {
  for (const box of boxes)
    box.addEventListener("change", () => {
      if (box.checked) for (const other of boxes) other.checked &&= other === box;
      show();
    });
  split.addEventListener("input", show);
  new ResizeObserver(show).observe(element("view"));
  show();
}
