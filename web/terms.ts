// SPDX-License-Identifier: Apache-2.0
/** The shading terms of the research behind lightprobe, one by one: what of a surface is left when one of them alone is shown. No DOM in this file. */
import type { Surface } from "./surface.js";

/** In the order of the page's list. "material": all that the material has. */
export const TERMS = ["material", "lambert", "blinn-phong", "ashikhmin-shirley", "premoze", "reflection", "refraction", "fresnel"] as const;
export type Term = (typeof TERMS)[number];

export interface TermSettings {
  /** Of the highlight: along the brush, of which Blinn–Phong takes the exponent, and across. */
  nu: number;
  nv: number;
  /** Refractive index of the object; that of air is 1. */
  index: number;
}

/** Which settings a term has. */
export const SETTINGS_OF: Record<Term, readonly (keyof TermSettings)[]> = {
  material: [], lambert: [], "blinn-phong": ["nu"], "ashikhmin-shirley": ["nu", "nv"], premoze: ["nu", "nv"], reflection: [], refraction: ["index"], fresnel: ["index"],
};

type Rgb = Surface["albedo"];
const BLACK: Rgb = [0, 0, 0], WHITE: Rgb = [1, 1, 1];
/** What a surface reflects at least straight on, so that chalk has a highlight, too. */
const LEAST_AT_NORMAL = 0.04;

const isBlack = (rgb: Rgb): boolean => rgb.every((value) => value === 0);

/** Reflectance straight on, by Fresnel, from air. */
export const atNormalOf = (index: number): number => ((index - 1) / (index + 1)) ** 2;

export function withTerm(surface: Surface, term: Term, { nu, nv, index }: TermSettings): Surface {
  if (term === "material") return surface;
  const alone: Surface = { ...surface, albedo: BLACK, atNormal: BLACK, highlight: "none", reflection: 0, refraction: 0, detail: 0 };
  const { albedo, atNormal } = surface, f = atNormalOf(index);
  switch (term) {
    case "lambert": return { ...alone, albedo: isBlack(albedo) ? (surface.refraction > 0 ? WHITE : atNormal) : albedo };
    case "reflection": return { ...alone, atNormal: WHITE, reflection: 1 };
    case "refraction": return { ...alone, refraction: 1, indexRatio: 1 / index };
    case "fresnel": return { ...alone, atNormal: [f, f, f], reflection: 1, refraction: 1, indexRatio: 1 / index };
    default: return { ...alone, albedo, atNormal: atNormal.map((value) => Math.max(value, LEAST_AT_NORMAL)) as unknown as Rgb, highlight: term, powers: [nu, nv] };
  }
}
