// SPDX-License-Identifier: Apache-2.0
/** What the objects are made of: twice, by three.js' physical materials and by the formulas of lightprobe.shading. */
import { MeshLambertMaterial, MeshPhysicalMaterial, ShaderChunk, type MeshStandardMaterial } from "three";
import { SurfaceMaterial, type Surface } from "./surface.js";

/** Diameter of a sphere, in metres: the way of light through the glass. */
export const DIAMETER_M = 0.32;

const DULL = { highlight: "none", powers: [1, 1], reflection: 0, refraction: 0, indexRatio: 1, detail: 0 } as const;
const SILVER = [0.972, 0.96, 0.915] as const, COPPER = [0.955, 0.638, 0.538] as const;
const BLACK = [0, 0, 0] as const, DIELECTRIC = [0.04, 0.04, 0.04] as const;

export const SURFACES = {
  chalk: { ...DULL, albedo: [0.88, 0.87, 0.82], atNormal: BLACK },
  plastic: { ...DULL, albedo: [0.53, 0.024, 0.024], atNormal: DIELECTRIC, highlight: "blinn-phong", powers: [120, 120], reflection: 0.6, detail: 1 },
  silver: { ...DULL, albedo: BLACK, atNormal: SILVER, highlight: "premoze", powers: [300, 15], reflection: 1, detail: 2.5 },
  copper: { ...DULL, albedo: BLACK, atNormal: COPPER, highlight: "premoze", powers: [150, 10], reflection: 1, detail: 2.5 },
  chrome: { ...DULL, albedo: BLACK, atNormal: [0.55, 0.556, 0.554], highlight: "ashikhmin-shirley", powers: [1500, 1500], reflection: 1 },
  glass: { ...DULL, albedo: BLACK, atNormal: DIELECTRIC, highlight: "ashikhmin-shirley", powers: [1500, 1500], reflection: 1, refraction: 1, indexRatio: 1 / 1.5 },
} satisfies Record<string, Surface>;

export type Name = keyof typeof SURFACES;

const brushed = { metalness: 1, anisotropy: 0.9, anisotropyRotation: Math.PI / 2 };

export const PHYSICAL: Record<Name, MeshLambertMaterial | MeshPhysicalMaterial> = {
  chalk: new MeshLambertMaterial({ color: 0xf2f0ea }),
  plastic: new MeshPhysicalMaterial({ color: 0xc0322b, roughness: 0.35, clearcoat: 0.6, clearcoatRoughness: 0.1 }),
  silver: new MeshPhysicalMaterial({ ...brushed, color: 0xfcfaf5, roughness: 0.35 }),
  copper: new MeshPhysicalMaterial({ ...brushed, color: 0xfad1c2, roughness: 0.4 }),
  chrome: new MeshPhysicalMaterial({ color: 0xc4c5c4, metalness: 1, roughness: 0.06 }),
  glass: new MeshPhysicalMaterial({ color: 0xffffff, roughness: 0.02, transmission: 1, thickness: DIAMETER_M, ior: 1.5 }),
};

export const BY_FORMULA = Object.fromEntries(Object.entries(SURFACES).map(([name, surface]) => [name, new SurfaceMaterial(surface)])) as Record<Name, SurfaceMaterial>;

export const NAMES = Object.keys(SURFACES) as Name[];

const CHUNK = "lights_fragment_maps", DIFFUSE = "iblIrradiance += getIBLIrradiance( geometryNormal );";

/** The same material, which takes no diffuse light from its environment map: it has that from the SH. */
export function mirroringOnly<T extends MeshStandardMaterial>(material: T): T {
  material.onBeforeCompile = (shader) => {
    const place = `#include <${CHUNK}>`, chunk = ShaderChunk[CHUNK];
    if (!shader.fragmentShader.includes(place) || !chunk.includes(DIFFUSE)) throw new Error(`materials: three.js' ${CHUNK} has changed: adapt web/materials.ts to this version of three.js`);
    shader.fragmentShader = shader.fragmentShader.replace(place, chunk.replace(DIFFUSE, ""));
  };
  return material;
}

/** Physical materials that show the surroundings by an environment map. */
export const MIRRORS = (["plastic", "silver", "copper", "chrome", "glass"] as const).map((name) => mirroringOnly(PHYSICAL[name] as MeshPhysicalMaterial));
