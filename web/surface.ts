// SPDX-License-Identifier: Apache-2.0
/**
 * Materials by the formulas of lightprobe.shading (host_py/lightprobe/shading.py, where the sources are named): Lambert,
 * Blinn–Phong, Ashikhmin–Shirley, Premoze's form of it, reflection and refraction of the surroundings with Fresnel.
 * three.js gives the lamps, their shadows and the SH; this file adds to its Lambert material.
 */
import { Color, CubeTexture, MeshLambertMaterial, Vector2, Vector3, type Texture } from "three";

type Rgb = readonly [number, number, number];

/** How bright a lamp is in a surface that shines; the order is that of the shader's `form`. */
export const FORMS = ["none", "blinn-phong", "ashikhmin-shirley", "premoze"] as const;

export interface Surface {
  /** Lambert; linear, Rec. 709. */
  albedo: Rgb;
  /** Reflectance straight on. Blinn–Phong is multiplied by it, the others have Fresnel's term (Schlick). */
  atNormal: Rgb;
  highlight: (typeof FORMS)[number];
  /** Powers of the highlight along the tangent and across; Blinn–Phong takes the first. */
  powers: readonly [number, number];
  /** Factor of what the surface mirrors of its surroundings, beside Fresnel's term. */
  reflection: number;
  /** Factor of what is seen through the surface, beside one minus Fresnel's term. */
  refraction: number;
  /** Refractive index before the surface over that behind it; at most 1. */
  indexRatio: number;
  /** Mip level at which the reflection map is read: larger for rougher surfaces. */
  detail: number;
}

const DECLARATIONS = /* glsl */ `
#include <lights_lambert_pars_fragment>

uniform vec3 atNormal;
uniform int form;
uniform vec2 powers;
uniform float reflection, refraction, indexRatio, detail;
uniform samplerCube reflectionMap;
uniform float mapIntensity; // 0: no map
uniform sampler2D ground;   // what an AR camera sees of a level square at y = 0 (ground.ts)
uniform float groundHalf;   // of its edge; 0: none
uniform float groundGain;
const float GROUND_FADE = 0.2; // at its border, this share of the half

vec3 fresnel(float cosine) { // Schlick
  return atNormal + (1.0 - atNormal) * pow(1.0 - saturate(cosine), 5.0);
}

/** Along the brush: the surface is brushed in circles around the vertical. */
vec3 tangentOf(vec3 n) {
  vec3 along = cross(viewMatrix[1].xyz, n);
  return dot(along, along) < 1e-8 ? viewMatrix[0].xyz : normalize(along);
}

/** Ashikhmin and Shirley's lobe, 1 for half vectors along the normal. */
float lobe(vec3 n, vec3 h) {
  vec3 tangent = tangentOf(n);
  vec2 part = vec2(dot(h, tangent), dot(h, cross(n, tangent)));
  part *= part;
  float sine2 = part.x + part.y;
  return sine2 < 1e-12 ? 1.0 : pow(saturate(dot(n, h)), dot(powers, part) / sine2);
}

/** BRDF of the highlight: normal, light and view point away from the surface. */
vec3 highlight(vec3 n, vec3 l, vec3 v) {
  float lit = dot(n, l), seen = dot(n, v);
  if (form == 0 || lit <= 0.0 || seen <= 0.0) return vec3(0.0);
  vec3 h = normalize(l + v);
  float p = powers.x, viewedHalf = dot(v, h);
  if (form == 1) return atNormal * (p + 2.0) * (p + 4.0) / (8.0 * PI * (p + exp2(-0.5 * p))) * pow(saturate(dot(n, h)), p);
  if (form == 2) return fresnel(viewedHalf) * sqrt((p + 1.0) * (powers.y + 1.0)) * lobe(n, h) / (8.0 * PI * viewedHalf * max(lit, seen));
  return fresnel(viewedHalf) * sqrt((p + 2.0) * (powers.y + 2.0)) * lobe(n, h) / (8.0 * PI * (lit + seen - lit * seen));
}

/** Radiance of what is far along a direction: of the reflection map, or without one of the SH. */
vec3 farAlong(vec3 d) {
  if (mapIntensity > 0.0) return mapIntensity * textureLod(reflectionMap, vec3(-d.x, d.yz), detail).rgb; // three.js' cube: from outside
#ifdef USE_LIGHT_PROBES
  vec3 sum = 0.282095 * lightProbe[0] + 0.488603 * (d.y * lightProbe[1] + d.z * lightProbe[2] + d.x * lightProbe[3])
    + 1.092548 * (d.x * d.y * lightProbe[4] + d.y * d.z * lightProbe[5] + d.x * d.z * lightProbe[7])
    + 0.315392 * (3.0 * d.z * d.z - 1.0) * lightProbe[6] + 0.546274 * (d.x * d.x - d.y * d.y) * lightProbe[8];
  return max(sum, 0.0);
#else
  return vec3(0.0);
#endif
}

/** Radiance that comes from a direction, both of the view: of the ground where the ray meets its square, else from far away. */
vec3 surroundings(vec3 direction) {
  vec3 d = transformDirectionByInverseViewMatrix(direction, viewMatrix), far = farAlong(d);
  vec3 from = cameraPosition + (vec4(-vViewPosition, 0.0) * viewMatrix).xyz; // viewMatrix turns: its inverse is its transpose
  if (groundHalf <= 0.0 || d.y >= 0.0 || from.y < 0.0) return far;
  vec2 met = (from.xz - from.y / d.y * d.xz) / groundHalf; // within the square −1…1
  vec4 near = textureLod(ground, 0.5 + 0.5 * met, 0.0); // 0 where the camera did not see it
  float share = clamp((1.0 - max(abs(met.x), abs(met.y))) / GROUND_FADE, 0.0, 1.0) * near.a;
  return mix(far, groundGain * near.rgb / max(near.a, 1e-4), share);
}

vec3 reflectedAndRefracted(vec3 n, vec3 v) {
  vec3 share = fresnel(dot(n, v)), sum = vec3(0.0);
  if (reflection > 0.0) sum += reflection * share * surroundings(reflect(-v, n));
  if (refraction > 0.0) sum += refraction * (1.0 - share) * surroundings(refract(-v, n, indexRatio));
  return sum;
}

void RE_Direct_Surface(const in IncidentLight directLight, const in vec3 position, const in vec3 n, const in vec3 v, const in vec3 clearcoatNormal, const in LambertMaterial material, inout ReflectedLight reflectedLight) {
  RE_Direct_Lambert(directLight, position, n, v, clearcoatNormal, material, reflectedLight);
  reflectedLight.directDiffuse += saturate(dot(n, directLight.direction)) * directLight.color * highlight(n, directLight.direction, v);
}
#undef RE_Direct
#define RE_Direct RE_Direct_Surface
`;

/** Each place of three's Lambert shader that is written anew. */
const PATCHES: [place: string, text: string][] = [
  ["#include <lights_lambert_pars_fragment>", DECLARATIONS],
  ["#include <opaque_fragment>", "outgoingLight += reflectedAndRefracted(geometryNormal, geometryViewDir);\n#include <opaque_fragment>"],
];

export class SurfaceMaterial extends MeshLambertMaterial {
  readonly #uniforms;

  constructor(surface: Surface) {
    super();
    this.#uniforms = {
      atNormal: { value: new Vector3() },
      form: { value: 0 },
      powers: { value: new Vector2() },
      reflection: { value: 0 },
      refraction: { value: 0 },
      indexRatio: { value: 1 },
      detail: { value: 0 },
      reflectionMap: { value: null as CubeTexture | null },
      mapIntensity: { value: 0 },
      ground: { value: null as Texture | null },
      groundHalf: { value: 0 },
      groundGain: { value: 0 },
    };
    this.set(surface);
    this.onBeforeCompile = (shader) => {
      Object.assign(shader.uniforms, this.#uniforms);
      for (const [place, text] of PATCHES) {
        if (!shader.fragmentShader.includes(place)) throw new Error(`surface: three.js' Lambert shader has no ${place}: adapt web/surface.ts to this version of three.js`);
        shader.fragmentShader = shader.fragmentShader.replace(place, text);
      }
    };
  }

  /** Another surface, from the next frame on; RangeError for one that is denser before than behind. */
  set(surface: Surface): void {
    if (!(surface.indexRatio > 0 && surface.indexRatio <= 1)) throw new RangeError(`indexRatio ${surface.indexRatio}: expected 0…1, light that enters a denser body`);
    this.color = new Color(...surface.albedo);
    this.#uniforms.atNormal.value.set(...surface.atNormal);
    this.#uniforms.form.value = FORMS.indexOf(surface.highlight);
    this.#uniforms.powers.value.set(...surface.powers);
    for (const name of ["reflection", "refraction", "indexRatio", "detail"] as const) this.#uniforms[name].value = surface[name];
  }

  /** What it mirrors, with mip levels; undefined: the SH of the scene's light probes. */
  setSurroundings(map: { texture: CubeTexture; intensity: number } | undefined): void {
    this.#uniforms.reflectionMap.value = map?.texture ?? null;
    this.#uniforms.mapIntensity.value = map?.intensity ?? 0;
  }

  /** The ground that it mirrors; undefined: none, the map is of all directions. */
  setGround(ground: { texture: Texture; sideM: number; gain: number } | undefined): void {
    this.#uniforms.ground.value = ground?.texture ?? null;
    this.#uniforms.groundHalf.value = (ground?.sideM ?? 0) / 2;
    this.#uniforms.groundGain.value = ground?.gain ?? 0;
  }
}
