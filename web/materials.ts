// SPDX-License-Identifier: Apache-2.0
/** What the objects are made of: twice, by three.js' physical materials and by the formulas of lightprobe.shading. */
import { Color, MeshLambertMaterial, MeshPhysicalMaterial, ShaderChunk, type MeshStandardMaterial, type WebGLProgramParametersWithUniforms } from "three";
import { SurfaceMaterial, type Surface } from "./surface.js";

/** Diameter of a sphere, in metres: the way of light through the glass. */
export const DIAMETER_M = 0.32;

const DULL = { highlight: "none", powers: [1, 1], reflection: 0, refraction: 0, indexRatio: 1, detail: 0 } as const;
const SILVER = [0.972, 0.96, 0.915] as const, COPPER = [0.955, 0.638, 0.538] as const;
const SKIN = [0.6, 0.31, 0.21] as const;
const BLACK = [0, 0, 0] as const, DIELECTRIC = [0.04, 0.04, 0.04] as const;

export const SURFACES = {
  chalk: { ...DULL, albedo: [0.88, 0.87, 0.82], atNormal: BLACK },
  plastic: { ...DULL, albedo: [0.53, 0.024, 0.024], atNormal: DIELECTRIC, highlight: "blinn-phong", powers: [120, 120], reflection: 0.6, detail: 1 },
  silver: { ...DULL, albedo: BLACK, atNormal: SILVER, highlight: "premoze", powers: [300, 15], reflection: 1, detail: 2.5 },
  copper: { ...DULL, albedo: BLACK, atNormal: COPPER, highlight: "premoze", powers: [150, 10], reflection: 1, detail: 2.5 },
  chrome: { ...DULL, albedo: BLACK, atNormal: [0.55, 0.556, 0.554], highlight: "ashikhmin-shirley", powers: [1500, 1500], reflection: 1 },
  glass: { ...DULL, albedo: BLACK, atNormal: DIELECTRIC, highlight: "ashikhmin-shirley", powers: [1500, 1500], reflection: 1, refraction: 1, indexRatio: 1 / 1.5 },
  skin: { ...DULL, albedo: SKIN, atNormal: [0.028, 0.028, 0.028], highlight: "blinn-phong", powers: [18, 18], reflection: 0.5, detail: 3 },
} satisfies Record<string, Surface>;

export type Name = keyof typeof SURFACES;

const brushed = { metalness: 1, anisotropy: 0.9, anisotropyRotation: Math.PI / 2 };

/** Wall of the goblet, in metres. */
const WALL_M = 0.012;
const GLASS = { color: 0xffffff, roughness: 0.02, transmission: 1, ior: 1.5 };

export const PHYSICAL: Record<Name | "goblet", MeshLambertMaterial | MeshPhysicalMaterial> = {
  chalk: new MeshLambertMaterial({ color: 0xf2f0ea }),
  plastic: new MeshPhysicalMaterial({ color: 0xc0322b, roughness: 0.35, clearcoat: 0.6, clearcoatRoughness: 0.1 }),
  silver: new MeshPhysicalMaterial({ ...brushed, color: 0xfcfaf5, roughness: 0.35 }),
  copper: new MeshPhysicalMaterial({ ...brushed, color: 0xfad1c2, roughness: 0.4 }),
  chrome: new MeshPhysicalMaterial({ color: 0xc4c5c4, metalness: 1, roughness: 0.06 }),
  glass: new MeshPhysicalMaterial({ ...GLASS, thickness: DIAMETER_M }),
  goblet: new MeshPhysicalMaterial({ ...GLASS, thickness: WALL_M }),
  skin: new MeshPhysicalMaterial({
    color: new Color(...SKIN), roughness: 0.48, specularIntensity: 0.7, sheen: 0.35, sheenRoughness: 0.45, sheenColor: new Color(0.7, 0.3, 0.22),
  }),
};

const FORMULAS = Object.fromEntries(Object.entries(SURFACES).map(([name, surface]) => [name, new SurfaceMaterial(surface)])) as Record<Name, SurfaceMaterial>;

export const BY_FORMULA: Record<Name | "goblet", SurfaceMaterial> = { ...FORMULAS, goblet: FORMULAS.glass };

/** What the spheres are made of, from left to right. */
export const SPHERES = ["chalk", "plastic", "silver", "copper", "chrome", "glass"] as const;

const CHUNK = "lights_fragment_maps", DIFFUSE = "iblIrradiance += getIBLIrradiance( geometryNormal );";

type Shader = WebGLProgramParametersWithUniforms;

/** Writes a place of three.js' shader anew; a version of three.js that has no such place is refused. */
function patch(shader: Shader, place: string, text: string): void {
  if (!shader.fragmentShader.includes(place)) throw new Error(`materials: three.js' physical shader has no ${place}: adapt web/materials.ts to this version of three.js`);
  shader.fragmentShader = shader.fragmentShader.replace(place, text);
}

/** Takes no diffuse light from the environment map: it has that from the SH. */
function leaveOutDiffuse(shader: Shader): void {
  const chunk = ShaderChunk[CHUNK];
  if (!chunk.includes(DIFFUSE)) throw new Error(`materials: three.js' ${CHUNK} has changed: adapt web/materials.ts to this version of three.js`);
  patch(shader, `#include <${CHUNK}>`, chunk.replace(DIFFUSE, ""));
}

/** The same material, which takes no diffuse light from its environment map. */
export function mirroringOnly<T extends MeshStandardMaterial>(material: T): T {
  material.onBeforeCompile = leaveOutDiffuse;
  return material;
}

/**
 * Light goes some way through skin, red furthest: around the edge of a shadow on the skin itself it fades over an angle of its own for
 * each colour, in place of Lambert's cosine: max(0, (cos + w) / (1 + w)²), which reflects as much in all.
 */
const SCATTERED = /* glsl */ `
#include <lights_physical_pars_fragment>

const vec3 SCATTERING = vec3(0.35, 0.12, 0.06);

void RE_Direct_Skin(const in IncidentLight directLight, const in vec3 position, const in vec3 n, const in vec3 v, const in vec3 clearcoatNormal, const in PhysicalMaterial material, inout ReflectedLight reflectedLight) {
  RE_Direct_Physical(directLight, position, n, v, clearcoatNormal, material, reflectedLight);
  float cosine = dot(n, directLight.direction);
  vec3 spread = max((vec3(cosine) + SCATTERING) / ((1.0 + SCATTERING) * (1.0 + SCATTERING)), 0.0);
  reflectedLight.directDiffuse += (spread - saturate(cosine)) * directLight.color * BRDF_Lambert(material.diffuseContribution);
}
#undef RE_Direct
#define RE_Direct RE_Direct_Skin
`;

function scattering(material: MeshPhysicalMaterial): MeshPhysicalMaterial {
  material.onBeforeCompile = (shader) => {
    leaveOutDiffuse(shader);
    patch(shader, "#include <lights_physical_pars_fragment>", SCATTERED);
  };
  return material;
}

/** Physical materials that show the surroundings by an environment map. */
export const MIRRORS = [
  ...(["plastic", "silver", "copper", "chrome", "glass", "goblet"] as const).map((name) => mirroringOnly(PHYSICAL[name] as MeshPhysicalMaterial)),
  scattering(PHYSICAL.skin as MeshPhysicalMaterial),
];
