/** Retargeting to a VRM humanoid: bones of joints, and rotations if the avatar lacks bones. */

import { conjugate, multiply, quaternionAt, type Quaternion } from "../body/math";
import type { Body, Skeleton } from "../body/skeleton";

const BODY: Readonly<Record<string, string>> = {
  pelvis: "hips",
  spine1: "spine",
  spine2: "chest",
  spine3: "upperChest",
  neck: "neck",
  head: "head",
};
const LIMBS: Readonly<Record<string, string>> = {
  collar: "Shoulder",
  shoulder: "UpperArm",
  elbow: "LowerArm",
  wrist: "Hand",
  hip: "UpperLeg",
  knee: "LowerLeg",
  ankle: "Foot",
  foot: "Toes",
  thumb1: "ThumbMetacarpal",
  thumb2: "ThumbProximal",
  thumb3: "ThumbDistal",
};
const FINGERS: Readonly<Record<string, string>> = { index: "Index", middle: "Middle", ring: "Ring", pinky: "Little" };
const PHALANGES = ["Proximal", "Intermediate", "Distal"] as const;

/** The VRM 1.0 humanoid bone of a joint, or null. */
export function boneOf(joint: string): string | null {
  if (joint in BODY) return BODY[joint];
  const [side, part] = joint.split("_");
  if (part === undefined || (side !== "left" && side !== "right")) return null;
  if (part in LIMBS) return side + LIMBS[part];
  const finger = FINGERS[part.slice(0, -1)];
  const phalanx = PHALANGES[Number(part.slice(-1)) - 1];
  return finger && phalanx ? `${side}${finger}${phalanx}` : null;
}

export interface Driven {
  readonly joint: number;
  readonly above: number; // nearest ancestor that the avatar has; −1: none
  readonly bone: string;
}

/** The joints that an avatar has bones for. */
export function drivenJoints(skeleton: Skeleton, hasBone: (bone: string) => boolean): Driven[] {
  const bones = skeleton.points.slice(0, skeleton.joints).map(boneOf);
  const isDriven = bones.map((bone) => bone !== null && hasBone(bone));
  return bones.flatMap((bone, joint) => {
    if (bone === null || !isDriven[joint]) return [];
    let above = skeleton.parents[joint];
    while (above >= 0 && !isDriven[above]) above = skeleton.parents[above];
    return [{ joint, above, bone }];
  });
}

/** A body's rotations from another rest pose than the T-pose, in which its joints are turned by `corrections`. */
export function fromRest({ position, rotation }: Body, corrections: readonly Quaternion[]): Body {
  const turned = new Float32Array(rotation.length);
  corrections.forEach((correction, joint) =>
    turned.set(multiply(quaternionAt(rotation, joint), conjugate(correction)), 4 * joint),
  );
  return { position, rotation: turned };
}

/** The rotation (wxyz) of a driven joint from the nearest one above it that is driven as well. */
export function localRotation({ rotation }: Body, { joint, above }: Driven): Quaternion {
  const own = quaternionAt(rotation, joint);
  return above < 0 ? own : multiply(conjugate(quaternionAt(rotation, above)), own);
}
