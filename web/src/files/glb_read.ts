/** glTF: the first animation of a file, as world poses of its nodes. */

import { AnimationMixer, Quaternion as Turn, Vector3, type Object3D } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import type { Quaternion, Vector } from "../body/math";
import type { RigMotion, RigPose } from "./rig";

const RATE = 30; // Hz
const LONGEST = 1200; // s

/** Throws an Error of one line for a file without motion. */
export function rigOfGlb({ scene, animations }: GLTF, name: string): RigMotion {
  const clip = animations[0];
  if (!clip) throw new Error(`${name} has no animation in it, and is no avatar; drop a file with a motion, or a .vrm.`);
  const nodes = nodesOf(scene);
  const rows = new Map(nodes.map((node, row) => [node, row]));
  const rest = poseOf(nodes);
  const mixer = new AnimationMixer(scene);
  mixer.clipAction(clip).play();
  const count = Math.floor(Math.min(clip.duration, LONGEST) * RATE) + 1;
  const frames = Array.from({ length: count }, (_, frame) => {
    mixer.setTime(Math.min(frame / RATE, clip.duration - 1e-4));
    scene.updateMatrixWorld(true);
    return poseOf(nodes);
  });
  return {
    name,
    joints: namesOf(nodes),
    parents: nodes.map(({ parent }) => (parent && rows.get(parent)) ?? -1),
    rate: RATE,
    rest,
    frames,
  };
}

/** All nodes of a scene, at rest. */
export function nodesOf(scene: Object3D): Object3D[] {
  const nodes: Object3D[] = [];
  scene.traverse((node) => nodes.push(node));
  scene.updateMatrixWorld(true);
  return nodes;
}

/** Names as the file has them; three.js leaves dots and colons out of its own. */
export function namesOf(nodes: readonly Object3D[]): string[] {
  return nodes.map(({ name, userData }) => String(userData["name"] ?? name));
}

export function poseOf(nodes: readonly Object3D[]): RigPose {
  const [place, turn] = [new Vector3(), new Turn()];
  return {
    position: nodes.map((node) => node.getWorldPosition(place).toArray() as Vector),
    rotation: nodes.map((node): Quaternion => {
      const { x, y, z, w } = node.getWorldQuaternion(turn);
      return [w, x, y, z];
    }),
  };
}
