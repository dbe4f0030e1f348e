/** Points of a headset as points of the body (bodysense_live.webxr): where each joint is by the device that wears it. */

import {
  add,
  conjugate,
  fromAxes,
  multiply,
  rotate,
  scaled,
  UPRIGHT,
  type Quaternion,
  type Vector,
} from "../body/math";
import { ACCURACY, type Point } from "../body/observation";
import type { SignalPoint } from "../protocol";
import { XR_POINTS } from "./xr_signal";

interface Rule {
  readonly name: string; // of our point
  readonly turn: Quaternion; // device ← our point
  readonly shift: Vector; // m, of our point in its own frame, from the device, on the default body
  readonly isTurned: boolean; // the device says how our point is turned
  readonly accuracy: number; // m
}

export type Landmarks = ReadonlyMap<string, Vector>;

// Axes of a device's frame where the wearer stands in the T-pose: x, y, z.
const LOOKING: readonly [Vector, Vector, Vector] = [
  [-1, 0, 0],
  [0, 1, 0],
  [0, 0, -1],
];
const HAND: Readonly<Record<string, readonly [Vector, Vector, Vector]>> = {
  left: [
    [0, 0, 1],
    [0, 1, 0],
    [-1, 0, 0],
  ],
  right: [
    [0, 0, -1],
    [0, 1, 0],
    [1, 0, 0],
  ],
};
const GRIP: Readonly<Record<string, readonly [Vector, Vector, Vector]>> = {
  left: [
    [0, -1, 0],
    [-1, 0, 0],
    [0, 0, -1],
  ],
  right: [
    [0, 1, 0],
    [1, 0, 0],
    [0, 0, -1],
  ],
};
const STILL: Vector = [0, 0, 0];
const SEGMENTS: Readonly<Record<string, string>> = {
  "phalanx-proximal": "1",
  "phalanx-intermediate": "2",
  "phalanx-distal": "3",
  tip: "_tip",
};
const THUMB: Readonly<Record<string, string>> = {
  metacarpal: "1",
  "phalanx-proximal": "2",
  "phalanx-distal": "3",
  tip: "_tip",
};

export class XrPoints {
  private readonly rules: readonly (Rule | null)[];

  constructor(landmarks: Landmarks) {
    this.rules = XR_POINTS.map((name) => ruleOf(name, landmarks));
  }

  /** Our points of one frame; of several devices on one joint the last counts. `size`: the wearer's, by the default body. */
  read(signal: readonly SignalPoint[], size: number): Point[] {
    const points = new Map<string, Point>();
    for (const { point, position, rotation } of signal) {
      const rule = this.rules[point];
      if (!rule) continue;
      const turned = rotation && multiply(rotation, rule.turn);
      const place = position && (turned ? add(position, rotate(turned, scaled(rule.shift, size))) : position);
      points.set(rule.name, {
        name: rule.name,
        position: place,
        rotation: rule.isTurned ? turned : null,
        accuracy: rule.accuracy,
      });
    }
    return [...points.values()];
  }
}

function ruleOf(name: string, landmarks: Landmarks): Rule | null {
  const away = (mark: string): Vector => scaled(landmarks.get(mark) ?? STILL, -1);
  const turnOf = (axes: readonly [Vector, Vector, Vector]): Quaternion => conjugate(fromAxes(...axes));
  if (name === "headset")
    return {
      name: "head",
      turn: turnOf(LOOKING),
      shift: away("between_eyes"),
      isTurned: true,
      accuracy: ACCURACY.headset,
    };
  const [side, rest] = name.split(/[_:]/, 2);
  if (rest === "controller") {
    return {
      name: `${side}_wrist`,
      turn: turnOf(GRIP[side]),
      shift: away(`${side}_palm`),
      isTurned: true,
      accuracy: ACCURACY.headset,
    };
  }
  if (rest === "wrist")
    return { name: `${side}_wrist`, turn: turnOf(HAND[side]), shift: STILL, isTurned: true, accuracy: ACCURACY.camera };
  const [finger, ...more] = rest.split("-");
  const segment = more.filter((word) => word !== "finger").join("-");
  const number = (finger === "thumb" ? THUMB : SEGMENTS)[segment];
  return number
    ? { name: `${side}_${finger}${number}`, turn: UPRIGHT, shift: STILL, isTurned: false, accuracy: ACCURACY.camera }
    : null;
}
