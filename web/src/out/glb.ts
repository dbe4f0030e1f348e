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
  type Object3D,
} from "three";
import { GLTFExporter } from "three/addons/exporters/GLTFExporter.js";
import { mergeGeometries } from "three/addons/utils/BufferGeometryUtils.js";
import { restPoints, type Skeleton } from "../body/skeleton";
import { boneOf } from "../view/retarget";
import type { Motion } from "./resample";

const UP = new Vector3(0, 1, 0);
const VRMA = "VRMC_vrm_animation";

/** The fields of an exporter that a plugin writes to; the types of three.js leave them out. */
interface Writing {
  readonly nodeMap: ReadonlyMap<Object3D, number>;
  readonly json: Record<string, unknown>;
}

export function glbBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  const { body, mesh } = figure(skeleton);
  // The mesh is a separate root: the transform of a skinned node is ignored, and validators warn about it.
  return written(new GLTFExporter(), [body, mesh], [[animation(skeleton, motion)], []]);
}

/** A skinned mesh, and the bones that move it: the skeleton's joints and end sites in their rest pose. */
function figure(skeleton: Skeleton): { readonly body: Group; readonly mesh: SkinnedMesh } {
  const bones = bonesOf(skeleton);
  const places = restPoints(skeleton).map((place) => new Vector3(...place).add(bones[0].position));
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

/** Joints and end sites in their rest pose, each below its parent. */
function bonesOf({ points, parents, restOffset }: Skeleton): Bone[] {
  const bones = points.map((name, point) => {
    const bone = new Bone();
    bone.name = name;
    bone.position.fromArray(restOffset, 3 * point);
    return bone;
  });
  parents.forEach((parent, point) => parent >= 0 && bones[parent].add(bones[point]));
  return bones;
}

/** A capsule from `place` along an offset, skinned to one bone. */
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
  const times = Float32Array.from({ length: motion.frames }, (_, frame) => frame / motion.rate);
  const tracks: KeyframeTrack[] = [new VectorKeyframeTrack(`${skeleton.points[0]}.position`, times, motion.root)];
  for (let joint = 0; joint < skeleton.joints; joint++) {
    tracks.push(
      new QuaternionKeyframeTrack(`${skeleton.points[joint]}.quaternion`, times, turnsOf(skeleton, motion, joint)),
    );
  }
  return new AnimationClip("motion", -1, tracks);
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
export function vrmaBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  const bones = bonesOf(skeleton);
  const exporter = new GLTFExporter().register((writer) => ({
    afterParse: () => {
      const { nodeMap, json } = writer as unknown as Writing;
      const named = bones.flatMap((bone) => {
        const [name, node] = [boneOf(bone.name), nodeMap.get(bone)];
        return name ? [[name, { node }] as const] : [];
      });
      writer.extensionsUsed[VRMA] = true;
      json["extensions"] = { [VRMA]: { specVersion: "1.0", humanoid: { humanBones: Object.fromEntries(named) } } };
    },
  }));
  return written(exporter, [bones[0]], [animation(skeleton, motion)]);
}

async function written(
  exporter: GLTFExporter,
  roots: Object3D[],
  animations: AnimationClip[] | AnimationClip[][],
): Promise<ArrayBuffer> {
  const result = await exporter.parseAsync(roots, { binary: true, animations });
  if (!(result instanceof ArrayBuffer)) throw new Error("The glTF exporter returned no bytes; report this.");
  return result;
}
