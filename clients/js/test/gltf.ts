// SPDX-License-Identifier: Apache-2.0
/** A small glTF object, as bytes of a .glb file: a cube of red metal, its colour in a picture inside the file. */

/** One red pixel, as PNG. */
const RED_PNG = "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAIAAACQd1PeAAAADElEQVR4nGP4z8EBAAMZARCrV6hSAAAAAElFTkSuQmCC";

export function redCube(roughness = 0.3): Buffer {
  const positions: number[] = [], normals: number[] = [], indices: number[] = [];
  for (const axis of [0, 1, 2])
    for (const side of [-1, 1]) {
      const first = positions.length / 3;
      for (const [u, v] of [[-1, -1], [1, -1], [1, 1], [-1, 1]] as const) {
        const corner = [0, 0, 0], normal = [0, 0, 0];
        [corner[axis], corner[(axis + 1) % 3], corner[(axis + 2) % 3], normal[axis]] = [side, side * u, v, side];
        positions.push(...corner);
        normals.push(...normal);
      }
      indices.push(...[0, 1, 2, 0, 2, 3].map((k) => first + k));
    }
  const parts = [Buffer.from(new Float32Array(positions).buffer), Buffer.from(new Float32Array(normals).buffer),
    Buffer.from(new Float32Array(positions.length * 2 / 3).buffer), Buffer.from(new Uint16Array(indices).buffer), Buffer.from(RED_PNG, "base64")];
  let offset = 0;
  const bufferViews = parts.map(({ length }) => {
    const view = { buffer: 0, byteOffset: offset, byteLength: length };
    offset += Math.ceil(length / 4) * 4;
    return view;
  });
  const count = positions.length / 3, vector = (bufferView: number, type: string): object => ({ bufferView, componentType: 5126, count, type });
  const document = {
    asset: { version: "2.0" }, scene: 0, scenes: [{ nodes: [0] }], nodes: [{ mesh: 0 }], buffers: [{ byteLength: offset }], bufferViews,
    accessors: [{ ...vector(0, "VEC3"), min: [-1, -1, -1], max: [1, 1, 1] }, vector(1, "VEC3"), vector(2, "VEC2"), { bufferView: 3, componentType: 5123, count: indices.length, type: "SCALAR" }],
    images: [{ bufferView: 4, mimeType: "image/png" }], textures: [{ source: 0 }],
    materials: [{ pbrMetallicRoughness: { baseColorTexture: { index: 0 }, metallicFactor: 1, roughnessFactor: roughness } }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0, NORMAL: 1, TEXCOORD_0: 2 }, indices: 3, material: 0 }] }],
  };
  const padded = (data: Buffer, by: number): Buffer => Buffer.concat([data, Buffer.alloc((4 - (data.length % 4)) % 4, by)]);
  const chunk = (data: Buffer, kind: number): Buffer => {
    const head = Buffer.alloc(8);
    head.writeUInt32LE(data.length, 0);
    head.writeUInt32LE(kind, 4);
    return Buffer.concat([head, data]);
  };
  const body = Buffer.concat([chunk(padded(Buffer.from(JSON.stringify(document)), 0x20), 0x4e4f534a), chunk(Buffer.concat(parts.map((part) => padded(part, 0))), 0x004e4942)]);
  const head = Buffer.alloc(12);
  head.write("glTF");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + body.length, 8);
  return Buffer.concat([head, body]);
}
