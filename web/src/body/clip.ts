/** A motion and its observation by simulated sensors. */

import { mixed, mixedTurns, quaternionAt, vectorAt } from "./math";
import { ACCURACY, type Observation } from "./observation";
import { place, type Body, type Skeleton } from "./skeleton";

export interface Clip {
  readonly name: string;
  readonly skeleton: Skeleton;
  readonly rate: number; // Hz
  readonly frames: number;
  readonly root: Float32Array; // (frames × 3) m
  readonly rotation: Float32Array; // (frames × joints × 4) wxyz, parent ← joint
}

/** Sensors that can be simulated: each gives position and rotation of its joint. */
export const SENSOR_SETS = {
  head: ["head"],
  hands: ["head", "left_wrist", "right_wrist"],
  hips: ["head", "left_wrist", "right_wrist", "pelvis"],
  feet: ["head", "left_wrist", "right_wrist", "pelvis", "left_ankle", "right_ankle"],
} as const satisfies Readonly<Record<string, readonly string[]>>;

export type SensorSet = keyof typeof SENSOR_SETS;

/** The body at a time, between frames: positions linearly, rotations along the shorter arc. */
export function bodyAt(clip: Clip, time: number): Body {
  const at = Math.min(Math.max(time * clip.rate, 0), clip.frames - 1);
  const first = Math.min(Math.floor(at), Math.max(clip.frames - 2, 0));
  const second = Math.min(first + 1, clip.frames - 1);
  const share = at - first;
  const width = 4 * clip.skeleton.joints;
  const turns = (frame: number): Float32Array => clip.rotation.subarray(width * frame, width * (frame + 1));
  const root = mixed(vectorAt(clip.root, first), vectorAt(clip.root, second), share);
  return place(clip.skeleton, root, mixedTurns(turns(first), turns(second), share));
}

/** Observe a body with simulated sensors. */
export function observe(body: Body, skeleton: Skeleton, sensors: readonly string[], time: number): Observation {
  const points = sensors.map((name) => {
    const point = skeleton.points.indexOf(name);
    const [position, rotation] = [vectorAt(body.position, point), quaternionAt(body.rotation, point)];
    return { name, position, rotation, accuracy: ACCURACY.exact };
  });
  return { time, points };
}
