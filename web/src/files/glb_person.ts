/** glTF: a character that is not a VRM. Joints of common names become a VRM's bones, in any rest pose. */

import { VRM, VRMHumanoid, type VRMHumanBones } from "@pixiv/three-vrm";
import { Box3, Group, type SkinnedMesh } from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import type { Skeleton } from "../body/skeleton";
import { Avatar } from "../view/avatar";
import { boneOf } from "../view/retarget";
import { namesOf, nodesOf, poseOf } from "./glb_read";
import { correctionsOf, personJoints } from "./rig";

/** Whether a file holds a figure without motion, and bones that move it. */
export function isFigure({ scene, animations }: GLTF): boolean {
  let isSkinned = false;
  scene.traverse((node) => (isSkinned ||= (node as Partial<SkinnedMesh>).isSkinnedMesh === true));
  return isSkinned && animations.length === 0;
}

/** Throws an Error of one line for a figure of no person. */
export function avatarOfGlb({ scene }: GLTF, name: string, tree: Skeleton): Avatar {
  const figure = new Group();
  figure.add(scene);
  scene.position.y -= new Box3().setFromObject(figure, true).min.y; // on the floor
  const nodes = nodesOf(figure);
  const joints = personJoints(namesOf(nodes), name);
  const bones = [...joints].flatMap(([joint, row]) => {
    const bone = boneOf(joint);
    return bone ? [[bone, { node: nodes[row] }] as const] : [];
  });
  const humanoid = new VRMHumanoid(Object.fromEntries(bones) as VRMHumanBones);
  figure.add(humanoid.normalizedHumanBonesRoot);
  const vrm = new VRM({ scene: figure, humanoid, meta: { metaVersion: "1", name, authors: [], licenseUrl: "" } });
  return new Avatar(vrm, correctionsOf(poseOf(nodes), joints, tree));
}
