// SPDX-License-Identifier: Apache-2.0
/**
 * What a glTF object may ask of the page, looked at before anything is made of it: a file of a few hundred bytes can ask for billions of
 * triangles, or for a loop without an end. No DOM in this file.
 */

const MOST_FILE_BYTES = 256 << 20, MOST_TEXT_BYTES = 64 << 20;
/** Of the JSON text: each becomes an object, a list or a value. */
const MOST_VALUES = 2_000_000;
/** `corners`: of triangles, in all places where a mesh is drawn. `numbers`: in all accessors. */
export const MOST = { nodes: 50_000, depth: 500, draws: 10_000, corners: 6_000_000, numbers: 1 << 26, bytes: 512 << 20, joints: 50_000, materials: 2000, lamps: 16 } as const;
const MOST_PIXELS = 128 << 20;
const SIMPLER = "take an object with fewer details";
const NUMBERS: Record<string, number> = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4, MAT2: 4, MAT3: 9, MAT4: 16 };
const GLB = 0x676c5446, JSON_CHUNK = 0x4e4f534a, MOST_CHUNKS = 16;

type Json = Record<string, unknown>;

const broken = (what: string): Error => new Error(`is no glTF object that this page can read: ${what}. Export it anew`);
const tooMuch = (what: string): Error => new Error(`${what}, more than this page shows: ${SIMPLER}`);

/** Those that are there; nothing where nothing is. What is no list would be gone through to the number that it calls its length. */
function list(value: unknown, name: string): unknown[] {
  if (value === undefined) return [];
  if (!Array.isArray(value)) throw broken(`${name} is no list`);
  return value as unknown[];
}

function objects(value: unknown, name: string): Json[] {
  const all = list(value, name);
  if (!all.every((one) => typeof one === "object" && one !== null)) throw broken(`${name} holds what is no object`);
  return all as Json[];
}

function count(value: unknown, name: string): number {
  if (value === undefined) return 0;
  if (!Number.isSafeInteger(value) || (value as number) < 0) throw broken(`${name} is no count`);
  return value as number;
}

function at<T>(all: T[], index: unknown, name: string): T {
  const found = typeof index === "number" ? all[index] : undefined;
  if (found === undefined) throw broken(`there is no such ${name} as ${String(index).slice(0, 20)}`);
  return found;
}

const part = (value: unknown): Json => (typeof value === "object" && value !== null ? value as Json : {});
const extension = (of: Json, name: string): Json => part(part(of["extensions"])[name]);
const sum = (values: number[]): number => values.reduce((total, value) => total + value, 0);

function need(is: number, most: keyof typeof MOST, words: string): void {
  if (!(is <= MOST[most])) throw tooMuch(`${words}: ${is.toLocaleString("en")} of at most ${MOST[most].toLocaleString("en")}`);
}

/** The JSON texts of a .glb file, of which the loader takes one; or all of a .gltf file. */
function textsOf(file: ArrayBuffer): Uint8Array[] {
  const view = new DataView(file), texts: Uint8Array[] = [];
  if (file.byteLength < 4 || view.getUint32(0, false) !== GLB) return [new Uint8Array(file)];
  for (let offset = 12, chunks = 0; offset + 8 <= file.byteLength; offset += 8 + view.getUint32(offset, true)) {
    if (++chunks > MOST_CHUNKS) throw broken(`it has more than ${MOST_CHUNKS} parts`);
    const bytes = Math.min(view.getUint32(offset, true), file.byteLength - offset - 8);
    if (view.getUint32(offset + 4, true) === JSON_CHUNK) texts.push(new Uint8Array(file, offset + 8, bytes));
  }
  return texts;
}

/** Before the file is read. */
export function checkObjectSize(bytes: number): void {
  if (bytes > MOST_FILE_BYTES) throw tooMuch(`it has ${Math.ceil(bytes / 2 ** 20)} MiB of at most ${MOST_FILE_BYTES >> 20}`);
}

/** Before it is parsed, so that this takes no longer than a second. */
export function checkObjectText(file: ArrayBuffer): void {
  const texts = textsOf(file), bytes = sum(texts.map((text) => text.length));
  if (bytes > MOST_TEXT_BYTES) throw tooMuch(`its JSON has ${Math.ceil(bytes / 2 ** 20)} MiB of at most ${MOST_TEXT_BYTES >> 20}`);
  let values = 0;
  for (const text of texts) for (const byte of text) if (byte === 0x2c || byte === 0x5b || byte === 0x7b) values++; // , [ {
  if (values > MOST_VALUES) throw tooMuch(`its JSON holds more than ${MOST_VALUES.toLocaleString("en")} values`);
}

/** Each node hangs on one other at most, and none on itself: else the loader waits for ever, or copies without an end. */
function checkTree(nodes: Json[], scenes: Json[]): void {
  const children = nodes.map((node) => list(node["children"], "a node's children"));
  const isChild = new Set<unknown>();
  for (const child of children.flat()) {
    at(nodes, child, "node");
    if (isChild.has(child)) throw broken("a node hangs on two others");
    isChild.add(child);
  }
  let reached = 0, depth = 0;
  for (let level: unknown[] = nodes.map((_, i) => i).filter((i) => !isChild.has(i)); level.length; level = level.flatMap((i) => children[i as number]!)) {
    reached += level.length;
    need(++depth, "depth", "its nodes hang one on another");
  }
  if (reached !== nodes.length) throw broken("a node hangs on itself");
  need(nodes.length * Math.max(1, scenes.length), "nodes", "nodes in all scenes");
  for (const shown of scenes.map((scene) => list(scene["nodes"], "a scene's nodes"))) {
    for (const one of shown) at(nodes, one, "node");
    if (new Set(shown).size !== shown.length || shown.some((one) => isChild.has(one))) throw broken("a node is shown twice");
  }
}

/** Error: a document that would hold the page up, or that is none. */
export function checkObject(document: unknown): void {
  const root = part(document), all = (name: string): Json[] => objects(root[name], name);
  const nodes = all("nodes"), meshes = all("meshes"), accessors = all("accessors");
  checkTree(nodes, all("scenes"));
  list(root["extensionsUsed"], "extensionsUsed");
  need(all("materials").length, "materials", "materials");
  need(sum(all("skins").map((skin) => list(skin["joints"], "a skin's joints").length)), "joints", "joints");
  need(nodes.filter((node) => extension(node, "KHR_lights_punctual")["light"] !== undefined).length, "lamps", "lamps of its own");
  need(sum(all("bufferViews").map((view) => count(view["byteLength"], "a length"))), "bytes", "bytes");
  const items = accessors.map((one) => Math.max(count(one["count"], "a count"), count(part(one["sparse"])["count"], "a count")));
  need(sum(accessors.map((one, i) => items[i]! * (NUMBERS[String(one["type"])] ?? 16))), "numbers", "numbers");
  checkDrawn(nodes, meshes, (index) => at(items, index, "accessor"));
}

function checkDrawn(nodes: Json[], meshes: Json[], items: (accessor: unknown) => number): void {
  const ofAttributes = (attributes: unknown): number => Object.values(part(attributes)).reduce<number>((most, one) => Math.max(most, items(one)), 0);
  const made = meshes.map((mesh) => {
    const primitives = objects(mesh["primitives"], "a mesh's primitives");
    list(mesh["weights"], "a mesh's weights");
    return {
      draws: primitives.length,
      corners: sum(primitives.map((one) => {
        const indices = one["indices"] === undefined ? 0 : items(one["indices"]);
        return Math.max(1, indices, ofAttributes(one["attributes"])) * (1 + objects(one["targets"], "a primitive's targets").length);
      })),
    };
  });
  const drawn = nodes.filter((node) => node["mesh"] !== undefined).map((node) => {
    const mesh = at(made, node["mesh"], "mesh");
    return { draws: mesh.draws, corners: mesh.corners * Math.max(1, ofAttributes(extension(node, "EXT_mesh_gpu_instancing")["attributes"])) };
  });
  const parts = [...made, ...drawn];
  need(sum(parts.map(({ draws }) => draws)), "draws", "parts that are drawn one by one");
  need(sum(parts.map(({ corners }) => corners)), "corners", "corners of triangles");
}

/** Leaves out what this page does not show: movements, and notes and long names, which the loader copies wherever a mesh is drawn. */
export function trim(document: unknown): void {
  const root = part(document), all = (name: string): Json[] => objects(root[name], name);
  root["animations"] = [];
  const meshes = all("meshes"), primitives = meshes.flatMap((mesh) => objects(mesh["primitives"], "a mesh's primitives"));
  for (const one of [...all("nodes"), ...all("cameras"), ...meshes, ...primitives]) delete one["extras"];
  for (const mesh of meshes) {
    delete mesh["extensions"];
    delete mesh["name"];
  }
}

/** Error: pictures of so many pixels that the page would stand still while they go to the graphics processor. */
export function checkPictures(pictures: { width: number; height: number }[]): void {
  const pixels = sum(pictures.map(({ width, height }) => width * height));
  if (pixels > MOST_PIXELS) throw tooMuch(`its pictures have ${Math.ceil(pixels / 2 ** 20)} million pixels of at most ${MOST_PIXELS >> 20}`);
}
