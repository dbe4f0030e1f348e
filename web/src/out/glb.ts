/** glTF: an armature that moves a figure of capsules, written by three.js; and VRMA, its motion as VRM's bones. */

import {
  AnimationClip,
  Bone,
  BufferAttribute,
  CapsuleGeometry,
  Group,
  MeshStandardMaterial,
  Quaternion,
  QuaternionKeyframeTrack,
  Skeleton as Armature,
  SkinnedMesh,
  Vector3,
  VectorKeyframeTrack,
  type BufferGeometry,
  type KeyframeTrack,
} from "three";
import { GLTFExporter } from "three/addons/exporters/GLTFExporter.js";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import type { Skeleton } from "../body/skeleton";
import { boneOf } from "../view/retarget";
import type { Motion } from "./resample";

const UP = new Vector3(0, 1, 0);
const [JSON_CHUNK, BIN_CHUNK, MAGIC] = [0x4e4f534a, 0x004e4942, 0x46546c67];
const FLOAT = 5126;

export async function glbBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  const { body, mesh } = figure(skeleton);
  const animations = [[animation(skeleton, motion)], []] as unknown as AnimationClip[]; // of each root, which types lack
  // The mesh is a root of its own: where a skin is, its node's place counts for nothing, and validators warn.
  const result = await new GLTFExporter().parseAsync([body, mesh], { binary: true, animations });
  if (!(result instanceof ArrayBuffer)) throw new Error("The glTF exporter returned no bytes; report this.");
  return result;
}

/** A skinned mesh, and the bones that move it: the skeleton's joints and end sites in their rest pose. */
function figure(skeleton: Skeleton): { readonly body: Group; readonly mesh: SkinnedMesh } {
  const bones = skeleton.points.map((name, point) => {
    const bone = new Bone();
    bone.name = name;
    bone.position.fromArray(skeleton.restOffset, 3 * point);
    return bone;
  });
  const places: Vector3[] = [];
  skeleton.parents.forEach((parent, point) => {
    if (parent >= 0) bones[parent].add(bones[point]);
    places.push(bones[point].position.clone().add(places[parent] ?? new Vector3()));
  });
  const parts = skeleton.parents.flatMap((parent, point) => {
    const part = parent < 0 ? null : capsule(places[parent], bones[point].position, parent);
    return part ? [part] : [];
  });
  const mesh = new SkinnedMesh(
    mergeGeometries(parts),
    new MeshStandardMaterial({ color: "#8fa9bd", roughness: 0.75, metalness: 0 }),
  );
  mesh.name = "figure";
  const body = new Group();
  body.name = "body";
  body.add(bones[0]);
  body.updateMatrixWorld(true);
  mesh.bind(new Armature(bones));
  return { body, mesh };
}

/** A capsule from a place along an offset, which follows one bone. */
function capsule(from: Vector3, offset: Vector3, bone: number): BufferGeometry | null {
  const length = offset.length();
  if (length < 0.005) return null;
  const geometry = new CapsuleGeometry(Math.min(0.16 * length, 0.05), length, 4, 10);
  geometry.applyQuaternion(new Quaternion().setFromUnitVectors(UP, offset.clone().normalize()));
  geometry.translate(from.x + offset.x / 2, from.y + offset.y / 2, from.z + offset.z / 2);
  const count = geometry.getAttribute("position").count;
  const follow = (value: number): number[] => Array.from({ length: 4 * count }, (_, k) => (k % 4 === 0 ? value : 0));
  geometry.setAttribute("skinIndex", new BufferAttribute(Uint8Array.from(follow(bone)), 4));
  geometry.setAttribute("skinWeight", new BufferAttribute(Float32Array.from(follow(1)), 4));
  geometry.deleteAttribute("uv");
  return geometry;
}

function animation(skeleton: Skeleton, motion: Motion): AnimationClip {
  const times = timesOf(motion);
  const tracks: KeyframeTrack[] = [new VectorKeyframeTrack(`${skeleton.points[0]}.position`, times, motion.root)];
  for (let joint = 0; joint < skeleton.joints; joint++) {
    tracks.push(
      new QuaternionKeyframeTrack(`${skeleton.points[joint]}.quaternion`, times, turnsOf(skeleton, motion, joint)),
    );
  }
  return new AnimationClip("motion", -1, tracks);
}

function timesOf({ frames, rate }: Motion): Float32Array<ArrayBuffer> {
  return Float32Array.from({ length: frames }, (_, frame) => frame / rate);
}

/** Rotations x y z w of a joint, one after the other. */
function turnsOf({ joints }: Skeleton, { frames, rotation }: Motion, joint: number): Float32Array<ArrayBuffer> {
  const values = new Float32Array(4 * frames);
  for (let frame = 0; frame < frames; frame++) {
    const [w, x, y, z] = rotation.subarray(4 * (joints * frame + joint));
    values.set([x, y, z, w], 4 * frame);
  }
  return values;
}

/** VRM animation 1.0: our rest pose is VRM's T-pose, so local rotations are the same. */
export async function vrmaBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  const parts: Float32Array<ArrayBuffer>[] = [];
  const views: object[] = [];
  const accessors: object[] = [];
  let size = 0;
  const accessor = (values: Float32Array<ArrayBuffer>, type: string, count: number, bounds: object = {}): number => {
    views.push({ buffer: 0, byteOffset: size, byteLength: values.byteLength });
    accessors.push({ bufferView: views.length - 1, componentType: FLOAT, count, type, ...bounds });
    parts.push(values);
    size += values.byteLength;
    return accessors.length - 1;
  };
  const times = timesOf(motion);
  const input = accessor(times, "SCALAR", motion.frames, { min: [0], max: [times[times.length - 1]] });
  const samplers: object[] = [];
  const channels: object[] = [];
  const channel = (node: number, path: string, output: number): void => {
    channels.push({ sampler: samplers.length, target: { node, path } });
    samplers.push({ input, output, interpolation: "LINEAR" });
  };
  channel(0, "translation", accessor(motion.root.slice(), "VEC3", motion.frames));
  const nodes = skeleton.points.slice(0, skeleton.joints).map((name, joint) => {
    channel(joint, "rotation", accessor(turnsOf(skeleton, motion, joint), "VEC4", motion.frames));
    const children = skeleton.parents.flatMap((parent, point) =>
      parent === joint && point < skeleton.joints ? [point] : [],
    );
    return {
      name,
      translation: [...skeleton.restOffset.subarray(3 * joint, 3 * joint + 3)],
      ...(children.length ? { children } : {}),
    };
  });
  const bones = nodes.flatMap(({ name }, node) => {
    const bone = boneOf(name);
    return bone ? [[bone, { node }] as const] : [];
  });
  const document = {
    asset: { version: "2.0", generator: "bodysense" },
    extensionsUsed: ["VRMC_vrm_animation"],
    extensions: { VRMC_vrm_animation: { specVersion: "1.0", humanoid: { humanBones: Object.fromEntries(bones) } } },
    scene: 0,
    scenes: [{ nodes: [0] }],
    nodes,
    animations: [{ name: "motion", channels, samplers }],
    accessors,
    bufferViews: views,
    buffers: [{ byteLength: size }],
  };
  const text = new TextEncoder().encode(JSON.stringify(document));
  const padded = new Uint8Array(Math.ceil(text.length / 4) * 4).fill(0x20);
  padded.set(text);
  const head = Uint32Array.of(MAGIC, 2, 28 + padded.length + size, padded.length, JSON_CHUNK);
  return new Blob([head, padded, Uint32Array.of(size, BIN_CHUNK), ...parts]).arrayBuffer();
}
