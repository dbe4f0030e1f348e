/** BVH: a tree and its channels, as world poses of a rig. */

import { add, axisAngle, multiply, rotate, UPRIGHT, type Quaternion, type Vector } from "../body/math";
import type { RigMotion, RigPose } from "./rig";

interface Joint {
  readonly name: string;
  readonly parent: number;
  offset: Vector;
  channels: readonly string[];
}

const AXES: Readonly<Record<string, Vector>> = { X: [1, 0, 0], Y: [0, 1, 0], Z: [0, 0, 1] };
const MOST_FRAMES = 60_000;
const MOST_JOINTS = 500;

/** Read a BVH. Throws an Error of one line for other text. */
export function readBvh(text: string, name: string): RigMotion {
  const [head, motion] = text.split(/^\s*MOTION\s*$/m);
  if (motion === undefined || !/^\s*HIERARCHY/.test(head))
    throw new Error(`${name} is no BVH file: it has no HIERARCHY and MOTION; export it again.`);
  const joints = treeOf(head, name);
  const lines = motion
    .split(/\r?\n/)
    .map((line) => line.trim())
    .filter(Boolean);
  const declared = Number(/^Frames:\s*(\d+)/.exec(lines[0] ?? "")?.[1]);
  const step = Number(/^Frame Time:\s*([\d.eE+-]+)/.exec(lines[1] ?? "")?.[1]);
  if (!Number.isInteger(declared) || !(step > 0))
    throw new Error(`${name} does not say its frames and their time; export it again.`);
  const rows = lines.slice(2);
  if (rows.length < declared)
    throw new Error(
      `${name} was cut short: its header says ${declared} frames, but it has ${rows.length}; export it again.`,
    );
  if (declared > MOST_FRAMES)
    throw new Error(`${name} has ${declared} frames; this page takes ${MOST_FRAMES}: cut it.`);
  const width = joints.reduce((sum, { channels }) => sum + channels.length, 0);
  const frames = rows.slice(0, declared).map((row, frame) => {
    const values = row.split(/\s+/).map(Number);
    if (values.length < width || !values.slice(0, width).every(Number.isFinite))
      throw new Error(`${name}: frame ${frame + 1} has no ${width} numbers; export it again.`);
    return poseOf(joints, values);
  });
  return {
    name,
    joints: joints.map((joint) => joint.name),
    parents: joints.map(({ parent }) => parent),
    rate: 1 / step,
    rest: poseOf(joints, null),
    frames,
  };
}

function treeOf(head: string, name: string): Joint[] {
  const joints: Joint[] = [];
  const open: number[] = []; // joints whose braces are open; −1 for an end site
  const words = head.split(/\s+/).filter(Boolean).slice(1);
  for (let k = 0; k < words.length; k++) {
    const word = words[k];
    const current = open.at(-1) ?? -1;
    if (word === "ROOT" || word === "JOINT") {
      const label: string[] = [];
      while (k + 1 < words.length && words[k + 1] !== "{") label.push(words[++k]);
      joints.push({ name: label.join(" "), parent: open.at(-1) ?? -1, offset: [0, 0, 0], channels: [] });
      if (joints.length > MOST_JOINTS) throw new Error(`${name} has more than ${MOST_JOINTS} joints; drop one person.`);
      open.push(joints.length - 1);
    } else if (word === "End") open.push(-1);
    else if (word === "}") open.pop();
    else if (word === "OFFSET") {
      const offset = words.slice(k + 1, k + 4).map(Number);
      if (offset.length < 3 || !offset.every(Number.isFinite))
        throw new Error(`${name}: an OFFSET has no three numbers; export it again.`);
      if (current >= 0) joints[current].offset = offset as unknown as Vector;
      k += 3;
    } else if (word === "CHANNELS") {
      const count = Number(words[k + 1]);
      if (current >= 0) joints[current].channels = words.slice(k + 2, k + 2 + count);
      k += 1 + count;
    }
  }
  if (joints.length === 0 || joints.some(({ parent }, row) => parent >= row))
    throw new Error(`${name} has no joints; export it again.`);
  return joints;
}

function poseOf(joints: readonly Joint[], values: readonly number[] | null): RigPose {
  const position: Vector[] = [];
  const rotation: Quaternion[] = [];
  let at = 0;
  for (const { parent, offset, channels } of joints) {
    let turn: Quaternion = UPRIGHT;
    let translation: [number, number, number] | null = null;
    for (const channel of channels) {
      const value = values ? values[at++] : 0;
      const axis = AXES[channel[0]] ?? [0, 1, 0];
      if (channel.endsWith("rotation")) turn = multiply(turn, axisAngle(axis, (value * Math.PI) / 180));
      else if (values) (translation ??= [0, 0, 0])[axis.indexOf(1)] = value;
    }
    const shift: Vector = translation ?? offset;
    position.push(parent < 0 ? shift : add(position[parent], rotate(rotation[parent], shift)));
    rotation.push(parent < 0 ? turn : multiply(rotation[parent], turn));
  }
  return { position, rotation };
}
