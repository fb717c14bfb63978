// SPDX-License-Identifier: Apache-2.0
/** The frozen bytes that every language decodes. Tests run in build/js. */
import { readFileSync, readdirSync } from "node:fs";
import { resolve } from "node:path";
import { fileURLToPath } from "node:url";

/** Root of the repository, seen from build/js/dist/test. */
export const ROOT = resolve(fileURLToPath(new URL(".", import.meta.url)), process.env["LIGHTPROBE_ROOT"] ?? "../../../..");
const FOLDER = resolve(ROOT, "proto/golden");

export const expected = JSON.parse(readFileSync(resolve(FOLDER, "v1.json"), "utf8")) as Record<string, Record<string, unknown>>;
const atPlaces = JSON.parse(readFileSync(resolve(FOLDER, "place.json"), "utf8")) as { lamps: LampVector[]; rooms: RoomVector[]; maps: MapVector[] };
/** Lamps as seen from places (tests/unit/place_vectors.py); what is not known is null. */
export const places = atPlaces.lamps;
/** Ambient light at places of rooms. */
export const rooms = atPlaces.rooms;
/** Reflection maps at places of rooms: every 67th number of the moved map. */
export const maps = atPlaces.maps;
interface LampVector { light: PlaceVector; position_m: [number, number, number]; there: PlaceVector }
interface RoomVector {
  room: { walls_m: number[]; orientation: [number, number, number, number] }; order: number; coefficients: number[];
  position_m: [number, number, number]; there: { coefficients: number[]; walls_m: number[] };
}
interface MapVector {
  room: RoomVector["room"]; frame: "PROBE" | "WORLD"; position_m: [number, number, number]; there: number[];
}
export interface PlaceVector {
  direction: [number, number, number]; irradiance: [number, number, number]; axis: [number, number, number] | null;
  half_angle_deg: [number, number] | null; angular_radius_deg: number; direction_sigma_deg: number | null; irradiance_sigma: number | null;
  distance_m: number | null; distance_sigma: number | null; nearest_m: number | null;
}
/** SH coefficients of the fallback light after an estimate; "": before the first. */
export const fallbacks = JSON.parse(readFileSync(resolve(FOLDER, "fallback.json"), "utf8")) as Record<string, number[]>;
export const names = readdirSync(FOLDER).filter((name) => name.endsWith(".bin"));

/** Bytes of one message, without the length before it. */
export function bytes(name: string): Uint8Array {
  const data = new Uint8Array(readFileSync(resolve(FOLDER, name)));
  let at = 0;
  while (data[at]! & 0x80) at++;
  return data.subarray(at + 1);
}
