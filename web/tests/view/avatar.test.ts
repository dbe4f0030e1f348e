import { readFileSync } from "node:fs";
import { AnimationClip, Vector3, type Mesh } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { rigOfGlb } from "../../src/files/glb_read";
import { Avatar, readGlb } from "../../src/view/avatar";
import { boneOf } from "../../src/view/retarget";
import { place } from "../../src/body/skeleton";
import { moment, skeleton } from "../body";
import { vrmBytes } from "../vrm_file.mjs";

function bytes(content: Buffer): ArrayBuffer {
  return Uint8Array.from(content).buffer;
}

async function read(content: Buffer, name: string): Promise<Avatar> {
  const avatar = Avatar.of(await readGlb(bytes(content), name), name);
  if (!avatar) throw new Error("no avatar");
  return avatar;
}

describe("an avatar", () => {
  it.each(["1", "0"] as const)("of VRM %s stands as the body does", async (version) => {
    const avatar = await read(vrmBytes(boneOf, version), "boxes.vrm");
    const { rootPosition, rotation } = moment(4, 0);
    const body = place(skeleton, rootPosition, rotation);
    avatar.show(body, skeleton, 0);
    avatar.group.updateMatrixWorld(true);
    for (let joint = 0; joint < skeleton.joints; joint++) {
      const node = avatar.group.getObjectByName(skeleton.points[joint]);
      const there = node?.getWorldPosition(new Vector3());
      expect(there?.distanceTo(new Vector3().fromArray(body.position, 3 * joint)), skeleton.points[joint]).toBeLessThan(
        1e-4,
      );
    }
  });

  it("without optional bones keeps its hands where they belong", async () => {
    const lacking = new Set(["upperChest", "neck", "leftShoulder", "rightShoulder"]);
    const some = (joint: string): string | null => (lacking.has(boneOf(joint) ?? "") ? null : boneOf(joint));
    const avatar = await read(vrmBytes(some), "boxes.vrm");
    const still = Float32Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
    const body = place(skeleton, [0, 1, 0], still);
    avatar.show(body, skeleton, 0);
    avatar.group.updateMatrixWorld(true);
    const wrist = skeleton.points.indexOf("left_wrist");
    const there = avatar.group.getObjectByName("left_wrist")?.getWorldPosition(new Vector3());
    expect(there?.distanceTo(new Vector3().fromArray(body.position, 3 * wrist))).toBeLessThan(1e-4);
  });

  it("is refused in one line where its file is damaged or no VRM", async () => {
    const whole = vrmBytes(boneOf);
    await expect(read(whole.subarray(0, 2000), "cut.vrm")).rejects.toThrow(
      /^cut\.vrm is damaged: [^\n]*; export it again\.$/,
    );
    const plain = Buffer.from(whole.toString("latin1").replaceAll("VRMC_vrm", "VRMC_xyz"), "latin1");
    await expect(read(plain, "plain.vrm")).rejects.toThrow(/^plain\.vrm is no VRM: it names no humanoid bones/);
  });
});

/** Vertices as meshoptimizer packs them (version 0 of its codec, bytes that are not made smaller); at most 16. */
function packed(vertices: Float32Array, stride: number): Uint8Array<ArrayBuffer> {
  const bytes = new Uint8Array(vertices.buffer, vertices.byteOffset, vertices.byteLength);
  const count = bytes.length / stride;
  const stream = [0xa0];
  for (let channel = 0; channel < stride; channel++) {
    stream.push(3); // the group of 16 is literal
    for (let vertex = 0; vertex < 16; vertex++) {
      const at = (k: number): number => bytes[Math.max(k, 0) * stride + channel];
      const change = vertex < count ? ((at(vertex) - at(vertex - 1)) << 24) >> 24 : 0;
      stream.push((change << 1) ^ ((change >> 7) & 0xff));
    }
  }
  stream.push(...new Array<number>(Math.max(32 - stride, 0)).fill(0), ...bytes.subarray(0, stride));
  return Uint8Array.from(stream);
}

it("of a mesh that meshoptimizer packed has its vertices", async () => {
  const vertices = Float32Array.from([0, 1, 0, 0.25, 1.5, -0.5, 3, -2, 0.125, 7, 8, 9]);
  const [content, stride] = [packed(vertices, 12), 12];
  const view = { buffer: 1, byteOffset: 0, byteLength: vertices.byteLength, byteStride: stride };
  const count = vertices.byteLength / stride;
  const extension = { ...view, buffer: 0, byteLength: content.length, count, mode: "ATTRIBUTES" };
  const json = {
    asset: { version: "2.0" },
    extensionsUsed: ["EXT_meshopt_compression"],
    extensionsRequired: ["EXT_meshopt_compression"],
    buffers: [{ byteLength: content.length }, { byteLength: vertices.byteLength }],
    bufferViews: [{ ...view, extensions: { EXT_meshopt_compression: extension } }],
    accessors: [{ bufferView: 0, componentType: 5126, count, type: "VEC3", min: [0, -2, -0.5], max: [7, 8, 9] }],
    meshes: [{ primitives: [{ attributes: { POSITION: 0 }, mode: 0 }] }],
    nodes: [{ mesh: 0 }],
    scenes: [{ nodes: [0] }],
    scene: 0,
  };
  const file = await readGlb(glb(json, content), "packed.glb");
  const [points] = file.scene.children as Mesh[];
  expect([...points.geometry.getAttribute("position").array]).toEqual([...vertices]);
});

describe("a .glb", () => {
  const asset = { version: "2.0" };
  const scene = { scenes: [{ nodes: [] }], scene: 0 };
  const brackets = (count: number) => "[".repeat(count) + "]".repeat(count);
  const nested = (count: number) => `{"asset":{"version":"2.0"},"scenes":[{}],"extras":${brackets(count)}}`;

  it.each<[string, object | string, string]>([
    ["nothing", { asset }, "f.glb is empty: no figure is in it"],
    [
      "300,000 nodes",
      { asset, ...scene, nodes: Array(300_000).fill({}) },
      "f.glb has 300000 nodes; this page takes 5000",
    ],
    ["a node too many", { asset, ...scene, nodes: Array(5001).fill({}) }, "f.glb has 5001 nodes"],
    ["many brackets", nested(3e6), "f.glb is nested in over 128 levels"],
    ["a level too many", nested(128), "f.glb is nested in over 128 levels"],
    ["long JSON", { asset, ...scene, extras: "x".repeat(16e6) }, "f.glb lists its parts in 17 MB of text"],
    ["words that are no JSON", "{nodes}", "f.glb is damaged"],
  ])("of %s is refused in one sentence", async (_, json, reason) => {
    await expect(readGlb(glb(json, new Uint8Array()), "f.glb")).rejects.toThrow(reason);
  });

  it.each<[string, object | string]>([
    ["as many nodes as are taken", { asset, ...scene, nodes: Array(5000).fill({}) }],
    ["as many levels as are taken", nested(127)],
    ["brackets in its words", { asset, ...scene, extras: { words: `\\"${"[{".repeat(999)}` } }],
  ])("of %s is read", async (_, json) => {
    expect((await readGlb(glb(json, new Uint8Array()), "f.glb")).scene.children).toEqual([]);
  });

  it("has its nodes' parents and places in its motion", async () => {
    const nodes = [
      { name: "a", translation: [1, 0, 0], children: [2, 1] },
      { name: "b", translation: [0, 2, 0] },
      { name: "c" },
    ];
    const { scene: root } = await readGlb(glb({ asset, nodes, scenes: [{ nodes: [0] }] }, new Uint8Array()), "f.glb");
    const motion = rigOfGlb({ scene: root, animations: [new AnimationClip("still", 0.1)] } as unknown as GLTF, "f.glb");
    expect(motion.joints.slice(1)).toEqual(["a", "c", "b"]);
    expect(motion.parents).toEqual([-1, 0, 1, 1]);
    expect(motion.frames.at(-1)?.position[3]).toEqual([1, 2, 0]);
  });
});

it("the page offers no file that it refuses by its name", () => {
  const page = readFileSync(new URL("../../index.html", import.meta.url), "utf8");
  expect(/accept="([^"]*)"/.exec(page)?.[1]).toBe(".bvh,.npz,.jsonl,.glb,.vrm,.vrma");
});

function glb(json: object | string, content: Uint8Array): ArrayBuffer {
  const text = typeof json === "string" ? json : JSON.stringify(json);
  const padded = new TextEncoder().encode(text.padEnd(4 * Math.ceil(text.length / 4)));
  const size = 4 * Math.ceil(content.length / 4);
  const file = new Uint8Array(28 + padded.length + size);
  const view = new DataView(file.buffer);
  [0x46546c67, 2, file.length, padded.length, 0x4e4f534a].forEach((value, k) => view.setUint32(4 * k, value, true));
  file.set(padded, 20);
  view.setUint32(20 + padded.length, size, true);
  view.setUint32(24 + padded.length, 0x004e4942, true);
  file.set(content, 28 + padded.length);
  return file.buffer;
}
