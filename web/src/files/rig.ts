/** A person's motion on any rig whose joints have common names, put on the page's own skeleton. */

import { Quaternion as Turn, Vector3 } from "three";
import type { Clip } from "../body/clip";
import {
  add,
  conjugate,
  cross,
  distance,
  dot,
  fromAxes,
  multiply,
  rotate,
  scaled,
  size,
  subtract,
  unit,
  UPRIGHT,
  vectorAt,
  type Quaternion,
  type Vector,
} from "../body/math";
import { place, restOf, type Skeleton } from "../body/skeleton";

/** A rig in world axes: positions and rotations of its joints, at rest and in every frame. */
export interface RigMotion {
  readonly name: string;
  readonly joints: readonly string[];
  readonly parents: readonly number[];
  readonly rate: number; // Hz
  readonly rest: RigPose;
  readonly frames: readonly RigPose[];
}

export interface RigPose {
  readonly position: readonly Vector[];
  readonly rotation: readonly Quaternion[];
}

const SIDED: Readonly<Record<string, RegExp>> = {
  collar: /^(collar|clavicle)(bone)?$/,
  shoulder: /^(up(per)?arm|arm|humerus)$/,
  elbow: /^(elbow|fore_?arm|low(er)?arm|radius)$/,
  wrist: /^(wrist|hand)$/,
  hip: /^(hip|up(per)?_?leg|thigh|femur)$/,
  knee: /^(knee|leg|low(er)?_?leg|shin|calf|tibia)$/,
  ankle: /^ankle$/,
  foot: /^(toe|toes|toebase|ball)$/,
};
const MIDDLE: Readonly<Record<string, RegExp>> = {
  pelvis: /^(pelvis|hips?|root)$/,
  neck: /^neck1?$/,
  head: /^head$/,
};
const SPINE = /^(lower|upper)?(spine|chest|torso|back|abdomen)(upper|lower)?\d*$/;
const FINGER = /^(?:hand)?(thumb|index|middle|ring|pinky|little)(metacarpal|proximal|intermediate|distal|\d)$/;
const PHALANX: Readonly<Record<string, number>> = { metacarpal: 1, proximal: 1, intermediate: 2, distal: 3 };
const NEEDED = [
  "pelvis",
  "head",
  ...["hip", "knee", "ankle", "shoulder", "elbow", "wrist"].flatMap((part) => [`left_${part}`, `right_${part}`]),
];
const UNITS = [1, 0.01, 0.001, 0.0254, 0.3048, 0.0564] as const; // m
const LEG = { least: 0.55, usual: 0.82, most: 1.1 } as const; // m
const UPRIGHT_SHARE = 0.15; // minimum share of frames in which a person is upright
const [STANDING, LYING] = [0.8, 0.4]; // how far up a spine points
const [ALONG, ACROSS] = [0.7, 0.6]; // cosines: at least the first is parallel, at most the second is perpendicular
const LEVEL = 0.35; // of a leg's length: what stands on one floor
const SOLE = 0.05; // m: the share of the frames in which the feet are that low does not matter

/** Where one of our joints is in a pose of a rig. */
type Placing = (pose: RigPose, joint: string) => Vector;

/** Which of our joints each joint of a rig is. */
export function jointsOf(names: readonly string[]): Map<string, number> {
  const found = new Map<string, number>();
  const put = (joint: string, row: number): unknown => found.has(joint) || found.set(joint, row);
  const split = names.map(parted);
  for (const [part, pattern] of Object.entries(SIDED))
    split.forEach(([side, rest], row) => side && pattern.test(rest) && put(`${side}_${part}`, row));
  for (const [joint, pattern] of Object.entries(MIDDLE))
    split.forEach(([side, rest], row) => !side && pattern.test(rest) && put(joint, row));
  split.forEach(([side, rest], row) => {
    if (!side) return;
    if (rest === "shoulder") put(found.has(`${side}_shoulder`) ? `${side}_collar` : `${side}_shoulder`, row);
    if (rest === "foot") put(found.has(`${side}_ankle`) ? `${side}_foot` : `${side}_ankle`, row);
    const finger = FINGER.exec(rest);
    if (finger) put(`${side}_${fingerOf(finger[1], finger[2])}`, row);
  });
  const spine = split.flatMap(([side, rest], row) => (!side && SPINE.test(rest) ? [row] : []));
  if (spine.length > 0) put("spine3", spine[spine.length - 1]);
  if (spine.length > 1) put("spine1", spine[0]);
  if (spine.length > 2) put("spine2", spine[spine.length >> 1]);
  return found;
}

function fingerOf(finger: string, phalanx: string): string {
  const number = PHALANX[phalanx] ?? Number(phalanx);
  if (finger === "thumb" && phalanx === "proximal") return "thumb2";
  return `${finger === "little" ? "pinky" : finger}${Math.min(Math.max(number, 1), 3)}`;
}

/** Side and part of a joint's name: 'mixamorig:LeftUpLeg' → left, upleg. */
function parted(name: string): readonly ["left" | "right" | null, string] {
  const plain = name.slice(name.lastIndexOf(":") + 1).replace(/^mixamorig\d*|^Bip\d+|^J_Bip_|^Character\d*_/i, "");
  const text = plain.replace(/[\s.\-]+/g, "_");
  const long =
    /^_?(left|right)_?(.+)$/i.exec(text) ?? /^(.+?)_?(left|right)$/i.exec(text)?.map((_, k, all) => all[[0, 2, 1][k]]);
  const short =
    long ??
    /^_?([lr])_(.+)$/i.exec(text) ??
    /^([lr])(?=[A-Z])(.+)$/.exec(text) ??
    /^(.+)_([lr])$/i.exec(text)?.map((_, k, all) => all[[0, 2, 1][k]]);
  const rest = (short?.[2] ?? text).replace(/^C_/, "").replaceAll("_", "").toLowerCase();
  if (!short) return [null, rest];
  return [short[1].toLowerCase().startsWith("l") ? "left" : "right", rest];
}

/** The joints of a person in a file. Throws an Error of one line if some are missing. */
export function personJoints(names: readonly string[], file: string): Map<string, number> {
  const joints = jointsOf(names);
  const missing = NEEDED.find((joint) => !joints.has(joint));
  if (missing === undefined) return joints;
  const few = names.slice(0, 4).join(", ");
  throw new Error(
    `${file} is no person that this page knows: none of its ${names.length} joints (${few} …) is a ${missing.replace("_", " ")}; drop a person whose joints have common names.`,
  );
}

/** Return the motion on our skeleton, scaled by the rig's legs. Throws an Error of one line for rigs of no person. */
export function clipOf(rig: RigMotion, tree: Skeleton): Clip {
  const joints = personJoints(rig.joints, rig.name);
  if (rig.frames.length < 2)
    throw new Error(`${rig.name} has ${rig.frames.length} frames; drop a motion of two or more.`);
  const at: Placing = ({ position }, joint) => position[joints.get(joint) ?? 0];
  if (rig.frames.filter((pose) => isOnFours(pose, at)).length > rig.frames.length / 2)
    throw new Error(
      `${rig.name} goes on four legs: it may be an animal; drop a motion of a person who stands, walks or sits.`,
    );
  if (isLying(rig, at))
    throw new Error(
      `${rig.name} lies down in most of its frames, or its axes are exchanged: its rest pose stands along another axis than its motion; drop a motion of a person who stands, walks or sits.`,
    );
  const level = levelled(rig, at);
  const leg = legOf((joint) => at(level.rest, joint));
  const unit_ = UNITS.reduce((best, metres) =>
    Math.abs(Math.log((leg * metres) / LEG.usual)) < Math.abs(Math.log((leg * best) / LEG.usual)) ? metres : best,
  );
  if (!(leg * unit_ > LEG.least && leg * unit_ < LEG.most))
    throw new Error(`${rig.name} has legs ${(leg * unit_).toFixed(2)} m long; drop the motion of an adult.`);
  const tilt = level.frames.map((pose) => spineOf(pose, at)[1]);
  if (tilt.filter((up) => up > 0.6).length < UPRIGHT_SHARE * tilt.length)
    throw new Error(
      `${rig.name} is never upright: it may be an animal, or lie on its side; drop a motion of a person with +Y or +Z up.`,
    );
  const own = legOf(restOf(tree));
  const skeleton = { ...tree, restOffset: tree.restOffset.map((value) => (value * leg * unit_) / own) };
  return onSkeleton(level, joints, skeleton, unit_);
}

/** Whether arms and legs point the same way, across the spine, and reach as far; whichever way is up. */
function isOnFours(pose: RigPose, at: Placing): boolean {
  const middle = (part: string): Vector => scaled(add(at(pose, `left_${part}`), at(pose, `right_${part}`)), 0.5);
  const legs = subtract(middle("ankle"), middle("hip"));
  const arms = subtract(middle("wrist"), middle("shoulder"));
  const spine = subtract(middle("shoulder"), middle("hip"));
  const [down, ahead] = [unit(add(unit(legs), unit(arms))), unit(spine)];
  const step = dot(subtract(middle("wrist"), middle("ankle")), down);
  const isAlong = dot(unit(legs), unit(arms)) > ALONG && Math.abs(dot(unit(legs), ahead)) < ACROSS;
  return isAlong && Math.abs(step) < LEVEL * size(legs);
}

function onSkeleton(rig: RigMotion, joints: ReadonlyMap<string, number>, skeleton: Skeleton, metres: number): Clip {
  const corrections = correctionsOf(rig.rest, joints, skeleton);
  const count = rig.frames.length;
  const root = new Float32Array(3 * count);
  const rotation = new Float32Array(4 * skeleton.joints * count);
  const lowest: number[] = [];
  rig.frames.forEach((pose, frame) => {
    const world: Quaternion[] = [];
    for (let joint = 0; joint < skeleton.joints; joint++) {
      const row = joints.get(skeleton.points[joint]);
      const parent = skeleton.parents[joint];
      world.push(
        row === undefined
          ? (world[parent] ?? UPRIGHT)
          : multiply(multiply(pose.rotation[row], conjugate(rig.rest.rotation[row])), corrections[joint]),
      );
      const local = parent < 0 ? world[joint] : multiply(conjugate(world[parent]), world[joint]);
      rotation.set(local, 4 * (frame * skeleton.joints + joint));
    }
    root.set(scaled(pose.position[joints.get("pelvis") ?? 0], metres), 3 * frame);
    const { position } = place(
      skeleton,
      root.subarray(3 * frame, 3 * frame + 3),
      rotation.subarray(4 * frame * skeleton.joints, 4 * (frame + 1) * skeleton.joints),
    );
    lowest.push(Math.min(...FEET.map((name) => position[3 * skeleton.points.indexOf(name) + 1])));
  });
  const floor = [...lowest].sort((a, b) => a - b)[Math.floor(SOLE * count)] - 0.015;
  for (let frame = 0; frame < count; frame++) {
    root[3 * frame + 1] -= floor;
    for (const k of [0, 2]) root[3 * frame + k] -= frame === 0 ? 0 : root[k];
  }
  root[0] = root[2] = 0;
  return { name: rig.name, skeleton, rate: rig.rate, frames: count, root, rotation };
}

const FEET = ["left_toe", "right_toe", "left_ankle", "right_ankle"];

/** World rotations of our joints, in their T-pose's axes, while the rig rests. */
export function correctionsOf(rest: RigPose, joints: ReadonlyMap<string, number>, skeleton: Skeleton): Quaternion[] {
  const at = (joint: string): Vector | null => rest.position[joints.get(joint) ?? -1] ?? null;
  const facing = multiply(
    facingOf((joint) => at(joint) ?? [0, 0, 0]),
    conjugate(facingOf(restOf(skeleton))),
  );
  const corrections: Quaternion[] = [];
  for (let joint = 0; joint < skeleton.joints; joint++) {
    const name = skeleton.points[joint];
    const parent = skeleton.parents[joint];
    const child = joint === 0 || /spine|neck|head|collar/.test(name) ? -1 : nextOf(name, skeleton);
    const [from, to] = [at(name), at(skeleton.points[child] ?? "")];
    const above =
      /_(shoulder|hip)$/.test(name) || joint === 0 || /spine|neck|head|collar/.test(name)
        ? facing
        : (corrections[parent] ?? facing);
    if (!from || !to || size(subtract(to, from)) < 1e-6) {
      corrections.push(above);
      continue;
    }
    const bone = rotate(above, vectorAt(skeleton.restOffset, child));
    const turn = new Turn().setFromUnitVectors(new Vector3(...unit(bone)), new Vector3(...unit(subtract(to, from))));
    corrections.push(multiply([turn.w, turn.x, turn.y, turn.z], above));
  }
  return corrections;
}

/** The axes of a standing body, from the positions of its joints. */
function facingOf(at: (joint: string) => Vector): Quaternion {
  const y = unit(subtract(at("head"), at("pelvis")));
  const z = unit(cross(unit(subtract(at("left_hip"), at("right_hip"))), y));
  return fromAxes(cross(y, z), y, z);
}

/** The point that a limb's bone leads to: the one with the same side and the next part. */
function nextOf(name: string, { points, parents }: Skeleton): number {
  const children = points.flatMap((_, point) => (parents[point] === points.indexOf(name) ? [point] : []));
  return children.find((point) => points[point].endsWith("middle1")) ?? children[0] ?? -1;
}

/** Whether a rest pose is upright along +Y while most frames are not. */
function isLying({ rest, frames }: RigMotion, at: Placing): boolean {
  const up = (pose: RigPose): number => spineOf(pose, at)[1];
  return up(rest) > STANDING && frames.filter((pose) => Math.abs(up(pose)) < LYING).length > frames.length / 2;
}

/** From pelvis to head, of length one. */
function spineOf(pose: RigPose, at: Placing): Vector {
  return unit(subtract(at(pose, "head"), at(pose, "pelvis")));
}

/** With +Y up: a rig with +Z up is turned. */
function levelled(rig: RigMotion, at: Placing): RigMotion {
  const sum = rig.frames.map((pose) => spineOf(pose, at)).reduce(add, [0, 0, 0]);
  if (Math.abs(sum[1]) >= Math.abs(sum[2])) return rig;
  const turn: Quaternion = [Math.SQRT1_2, -Math.SQRT1_2 * Math.sign(sum[2]), 0, 0];
  const turned = ({ position, rotation }: RigPose): RigPose => ({
    position: position.map((p) => rotate(turn, p)),
    rotation: rotation.map((q) => multiply(turn, q)),
  });
  return { ...rig, rest: turned(rig.rest), frames: rig.frames.map(turned) };
}

/** The mean length of two legs at rest. */
function legOf(at: (joint: string) => Vector): number {
  const length = (side: string): number =>
    distance(at(`${side}_hip`), at(`${side}_knee`)) + distance(at(`${side}_knee`), at(`${side}_ankle`));
  return (length("left") + length("right")) / 2;
}
