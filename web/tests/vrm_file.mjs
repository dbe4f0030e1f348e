/** A small VRM avatar of boxes, made from the default body: for tests, so that nobody's avatar has to be kept here. */

import { readFileSync } from "node:fs";
import { createEncoderModule } from "draco3d";

const BODY = JSON.parse(readFileSync(new URL("../../src/bodysense/body/default_body.json", import.meta.url), "utf8"));
const META = { name: "boxes", authors: ["the bodysense developers"], licenseUrl: "https://vrm.dev/licenses/1.0/" };
const DRACO = "KHR_draco_mesh_compression";
const SIZE = 0.03; // m, half an edge

/** The bytes of a .vrm; `boneOf` names the bone of a joint (null: none), `version` is "1" or "0" (which faces −Z).
 *
 * `mesh`: what stands at each joint, `box()` or `packedBox()`.
 */
export function vrmBytes(boneOf, version = "1", mesh = box()) {
  const flip = version === "0" ? -1 : 1;
  const names = BODY.joints.map(({ name }) => name);
  const parents = BODY.joints.map(({ parent }) => names.indexOf(parent));
  const nodes = BODY.joints.map(({ name, offset: [x, y, z] }, joint) => ({
    name,
    mesh: 0,
    translation: [flip * x, joint === 0 ? rootHeight() : y, flip * z],
    children: names.map((_, child) => child).filter((child) => parents[child] === joint),
  }));
  for (const node of nodes) if (node.children.length === 0) delete node.children;
  const bones = names.flatMap((name, node) => (boneOf(name) === null ? [] : [[boneOf(name), node]]));
  const { binary, extensionsUsed = [], ...parts } = mesh;
  const { extensionsUsed: named, ...about } = humanoid(bones, version);
  const json = {
    asset: { version: "2.0" },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes,
    ...parts,
    ...about,
    extensionsUsed: [...extensionsUsed, ...named],
  };
  return glb(JSON.stringify(json), binary);
}

function humanoid(bones, version) {
  if (version === "1") {
    const humanBones = Object.fromEntries(bones.map(([bone, node]) => [bone, { node }]));
    const extension = { specVersion: "1.0", meta: META, humanoid: { humanBones } };
    return { extensionsUsed: ["VRMC_vrm"], extensions: { VRMC_vrm: extension } };
  }
  const old = { ThumbProximal: "ThumbIntermediate", ThumbMetacarpal: "ThumbProximal" }; // VRM 0 counts thumbs otherwise
  const humanBones = bones.map(([bone, node]) => ({
    bone: bone.replace(/Thumb(Proximal|Metacarpal)$/, (name) => old[name]),
    node,
    useDefaultValues: true,
  }));
  const extension = { specVersion: "0.0", meta: { title: "boxes" }, humanoid: { humanBones } };
  return { extensionsUsed: ["VRM"], extensions: { VRM: extension } };
}

function rootHeight() {
  const height = new Map();
  for (const { name, parent, offset } of [...BODY.joints, ...BODY.end_sites]) {
    height.set(name, parent === null ? 0 : height.get(parent) + offset[1]);
  }
  return -Math.min(...height.values());
}

/** Corners and triangles of a box. */
function boxShape() {
  const corners = [0, 1, 2, 3, 4, 5, 6, 7].map((k) => [0, 1, 2].map((axis) => (k & (1 << axis) ? SIZE : -SIZE)));
  const faces = [
    [0, 2, 3, 1],
    [4, 5, 7, 6],
    [0, 1, 5, 4],
    [2, 6, 7, 3],
    [0, 4, 6, 2],
    [1, 3, 7, 5],
  ];
  const indices = Uint16Array.from(faces.flatMap(([a, b, c, d]) => [a, b, c, a, c, d]));
  return { indices, positions: Float32Array.from(corners.flat()) };
}

/** One box as a glTF mesh that Draco packed. */
export async function packedBox() {
  const [draco, { indices, positions }] = [await createEncoderModule(), boxShape()];
  const [mesh, builder, packed] = [new draco.Mesh(), new draco.MeshBuilder(), new draco.DracoInt8Array()];
  builder.AddFacesToMesh(mesh, indices.length / 3, Uint32Array.from(indices));
  const position = builder.AddFloatAttributeToMesh(mesh, draco.POSITION, 8, 3, positions);
  const length = new draco.Encoder().EncodeMeshToDracoBuffer(mesh, packed);
  const { meshes, accessors } = box();
  const extensions = { [DRACO]: { bufferView: 0, attributes: { POSITION: position } } };
  return {
    binary: Buffer.from(Int8Array.from({ length }, (_, k) => packed.GetValue(k)).buffer),
    meshes: [{ primitives: [{ ...meshes[0].primitives[0], extensions }] }],
    buffers: [{ byteLength: length }],
    bufferViews: [{ buffer: 0, byteLength: length }],
    accessors: accessors.map(({ bufferView: _, ...accessor }) => accessor),
    extensionsUsed: [DRACO],
    extensionsRequired: [DRACO],
  };
}

/** One box as a glTF mesh. */
function box() {
  const { indices, positions } = boxShape();
  const binary = Buffer.concat([Buffer.from(positions.buffer), Buffer.from(indices.buffer)]);
  return {
    binary,
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, indices: 1 }] }],
    buffers: [{ byteLength: binary.length }],
    bufferViews: [
      { buffer: 0, byteOffset: 0, byteLength: positions.byteLength },
      { buffer: 0, byteOffset: positions.byteLength, byteLength: indices.byteLength },
    ],
    accessors: [
      {
        bufferView: 0,
        componentType: 5126,
        count: 8,
        type: "VEC3",
        min: [-SIZE, -SIZE, -SIZE],
        max: [SIZE, SIZE, SIZE],
      },
      { bufferView: 1, componentType: 5123, count: indices.length, type: "SCALAR" },
    ],
  };
}

function glb(json, binary) {
  const chunk = (kind, content, padding) => {
    const head = Buffer.alloc(8);
    const padded = Buffer.concat([content, Buffer.alloc(-content.length & 3, padding)]);
    head.writeUInt32LE(padded.length, 0);
    head.write(kind, 4, "latin1");
    return Buffer.concat([head, padded]);
  };
  const chunks = Buffer.concat([chunk("JSON", Buffer.from(json), " "), chunk("BIN\0", binary, 0)]);
  const head = Buffer.alloc(12);
  head.write("glTF", 0, "latin1");
  head.writeUInt32LE(2, 4);
  head.writeUInt32LE(12 + chunks.length, 8);
  return Buffer.concat([head, chunks]);
}
