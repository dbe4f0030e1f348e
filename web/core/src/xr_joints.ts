/** The 83 joints of WebXR's body from a completed body.
 *
 * A joint is on one of our bones, whose start carries it. Its −Z points along the bone, to the next joint. Its −Y points
 * out of the palm, as the specification says; of the rest of a body, out of the sole, the back of a leg and the front of
 * the trunk, the thumb's pad.
 */

import { add, cross, dot, fromAxes, multiply, normalized, rotate, scaled, subtract, unit } from "./math.js";
import type { Estimate, Quaternion, Vector } from "./types.js";

/** Where a joint is and how it is turned, and whether the point that carries it was measured. */
export type JointPose = Readonly<{ position: Vector; rotation: Quaternion; isMeasured: boolean }>;

interface Rule {
  readonly start: string; // our joint, which carries the joint
  readonly end: string; // our point at the bone's other end
  readonly share: Vector; // of the bone, from its start, along the axes of the T-pose
  readonly up: Vector; // about +Y of the joint in the T-pose
  readonly twist?: string; // our joint whose turn about the bone the joint shares
}

// Shares of bones, by anatomy.
const CHEST = 1 / 3; // of spine3 to the neck: the middle of the breastbone
const SCAPULA = 0.8; // of the collarbone: the joint with the shoulder blade
const TWIST = 0.9; // of forearm and shank: the far joint of its two bones
const METACARPAL = 0.4; // of wrist to knuckle: the bones of the wrist end there
const FANNED = 0.75; // of how far a knuckle is to the side: metacarpals are nearly parallel
const [SUBTALAR, TRANSVERSE] = [0.15, 0.4]; // of ankle to ball: below and before the ankle bone
const [UP, FORWARD, BACK]: readonly Vector[] = [
  [0, 1, 0],
  [0, 0, 1],
  [0, 0, -1],
];

/** Parents of our 52 joints. */
const PARENTS = [
  -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 22, 23, 20, 25, 26, 20, 28, 29, 20, 31,
  32, 20, 34, 35, 21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50,
];

function on(start: string, end: string, part: number | Vector = 0, up: Vector = UP!, twist?: string): Rule {
  const share: Vector = typeof part === "number" ? [part, part, part] : part;
  return { start, end, share, up, ...(twist && { twist }) };
}

function arm(side: string): [string, Rule][] {
  const [collar, shoulder, elbow, wrist] = ["collar", "shoulder", "elbow", "wrist"].map((name) => `${side}_${name}`);
  return [
    [`${side}-shoulder`, on(collar!, shoulder!)],
    [`${side}-scapula`, on(collar!, shoulder!, SCAPULA)],
    [`${side}-arm-upper`, on(shoulder!, elbow!)],
    [`${side}-arm-lower`, on(elbow!, wrist!)],
    [`${side}-hand-wrist-twist`, on(elbow!, wrist!, TWIST, UP, wrist)],
  ];
}

function hand(side: string): [string, Rule][] {
  const [wrist, name] = [`${side}_wrist`, `${side}-hand`];
  const nail: Vector = [side === "left" ? -0.6 : 0.6, 0, 0.8]; // across the thumb's axis of flexion (body/hands/hand.py)
  const finger = (ours: string, theirs: string, first: string[], up?: Vector): [string, Rule][] =>
    [...first, "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"]
      .filter((segment) => ours !== "thumb" || segment !== "phalanx-intermediate")
      .map((segment, k) => {
        const bone = Math.min(ours === "thumb" ? k + 1 : k, 3);
        const [start, end] = [bone, bone + 1].map((n) => `${side}_${ours}${n === 4 ? "_tip" : n}`);
        const rule =
          bone === 0
            ? on(wrist, end!, [METACARPAL, METACARPAL, FANNED], up)
            : on(start!, end!, segment === "tip" ? 1 : 0, up);
        return [`${name}-${theirs}-${segment}`, rule];
      });
  return [
    [`${name}-palm`, on(wrist, `${side}_middle1`, (1 + METACARPAL) / 2)],
    [`${name}-wrist`, on(wrist, `${side}_middle1`)],
    ...finger("thumb", "thumb", ["metacarpal"], nail),
    ...finger("index", "index", ["metacarpal"]),
    ...finger("middle", "middle", ["phalanx-metacarpal"]), // so named by the specification
    ...finger("ring", "ring", ["metacarpal"]),
    ...finger("pinky", "little", ["metacarpal"]),
  ];
}

function leg(side: string): [string, Rule][] {
  const [hip, knee, ankle, foot, toe] = ["hip", "knee", "ankle", "foot", "toe"].map((name) => `${side}_${name}`);
  return [
    [`${side}-upper-leg`, on(hip!, knee!, 0, FORWARD)],
    [`${side}-lower-leg`, on(knee!, ankle!, 0, FORWARD)],
    [`${side}-foot-ankle-twist`, on(knee!, ankle!, TWIST, FORWARD, ankle)],
    [`${side}-foot-ankle`, on(ankle!, foot!)],
    [`${side}-foot-subtalar`, on(ankle!, foot!, SUBTALAR)],
    [`${side}-foot-transverse`, on(ankle!, foot!, TRANSVERSE)],
    [`${side}-foot-ball`, on(foot!, toe!)],
  ];
}

/** The specification's joints, in its order. */
const RULES: ReadonlyMap<string, Rule> = new Map([
  ["hips", on("pelvis", "spine1", 0, BACK)],
  ["spine-lower", on("spine1", "spine2", 0, BACK)],
  ["spine-middle", on("spine2", "spine3", 0, BACK)],
  ["spine-upper", on("spine3", "neck", 0, BACK)],
  ["chest", on("spine3", "neck", CHEST, BACK)],
  ["neck", on("neck", "head", 0, BACK)],
  ["head", on("head", "head_top", 0, BACK)],
  ...["left", "right"].flatMap(arm),
  ...["left", "right"].flatMap(hand),
  ...["left", "right"].flatMap(leg),
]);

export const JOINT_NAMES: readonly string[] = [...RULES.keys()];

/** The poses of all joints, by name, in the frame of the body. `points`: the model's. */
export function jointPoses(body: Estimate, points: readonly string[]): ReadonlyMap<string, JointPose> {
  const vector = (from: Float64Array, k: number): Vector => [from[3 * k]!, from[3 * k + 1]!, from[3 * k + 2]!];
  const local = (k: number): Quaternion => [0, 1, 2, 3].map((n) => body.rotation[4 * k + n]!) as unknown as Quaternion;
  const world: Quaternion[] = [];
  PARENTS.forEach((parent, k) => world.push(parent < 0 ? local(k) : multiply(world[parent]!, local(k))));
  const pose = ({ start, end, share, up, twist }: Rule): JointPose => {
    const [from, to] = [points.indexOf(start), points.indexOf(end)];
    const bone = vector(body.restOffset, to);
    const offset: Vector = [bone[0] * share[0], bone[1] * share[1], bone[2] * share[2]];
    const z = unit(share[0] === 1 ? scaled(bone, -1) : subtract(offset, bone)); // a tip goes on as its bone
    const y = unit(subtract(up, scaled(z, dot(up, z))));
    const turned = twist ? multiply(world[from]!, about(z, local(points.indexOf(twist)))) : world[from]!;
    return {
      position: add(vector(body.points, from), rotate(world[from]!, offset)),
      rotation: normalized(multiply(turned, fromAxes(cross(y, z), y, z))),
      isMeasured: body.measured[from] === 1,
    };
  };
  return new Map([...RULES].map(([name, rule]) => [name, pose(rule)]));
}

/** The part of a rotation that turns about an axis. */
function about(axis: Vector, [w, x, y, z]: Quaternion): Quaternion {
  return normalized([w, ...scaled(axis, dot([x, y, z], axis))]);
}
