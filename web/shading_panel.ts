// SPDX-License-Identifier: Apache-2.0
/** The page's list of shading terms, with a slider for what each has to be set. */
import { SETTINGS_OF, type Term, type TermSettings } from "./terms.js";

const element = <T extends HTMLElement>(id: string): T => document.getElementById(id) as T;

/** Exponents are chosen on a scale that is even for the eye: this to the power of the slider. */
const POWER_BASE = 10;
const valueOf: Record<keyof TermSettings, (slider: number) => number> = {
  nu: (slider) => Math.round(POWER_BASE ** slider), nv: (slider) => Math.round(POWER_BASE ** slider), index: (slider) => slider,
};

function settings(): TermSettings {
  const read = (name: keyof TermSettings): number => valueOf[name](element<HTMLInputElement>(`set-${name}`).valueAsNumber);
  return { nu: read("nu"), nv: read("nv"), index: read("index") };
}

/** Calls `apply` with each choice. The list is there while the formulas are on. */
export function wireShading(apply: (term: Term, settings: TermSettings) => void): void {
  const box = element<HTMLInputElement>("use-formulas"), list = element<HTMLSelectElement>("term");
  const show = (): void => {
    const term = list.value as Term, now = settings();
    element("shading").hidden = !box.checked;
    for (const name of Object.keys(now) as (keyof TermSettings)[]) {
      element(`row-${name}`).hidden = !SETTINGS_OF[term].includes(name);
      element<HTMLOutputElement>(`out-${name}`).value = String(now[name]);
    }
    apply(term, now);
  };
  box.addEventListener("change", show);
  for (const id of ["term", "set-nu", "set-nv", "set-index"]) element(id).addEventListener("input", show);
  show();
}
