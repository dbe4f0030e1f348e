/** Vectors and wxyz quaternions: those of the package, and functions that only the page needs. */

import { add, normalized, scaled, size, subtract, UPRIGHT } from "@bodysense/core/math";
import type { Quaternion, Vector } from "@bodysense/core";

export * from "@bodysense/core/math";
export type { Quaternion, Vector } from "@bodysense/core";

export const distance = (a: Vector, b: Vector): number => size(subtract(a, b));

/** The vector in a row of an array of three columns. */
export const vectorAt = (values: ArrayLike<number>, row: number): Vector => [
  values[3 * row],
  values[3 * row + 1],
  values[3 * row + 2],
];

/** The quaternion in a row of an array of four columns. */
export const quaternionAt = (values: ArrayLike<number>, row: number): Quaternion => [
  values[4 * row],
  values[4 * row + 1],
  values[4 * row + 2],
  values[4 * row + 3],
];

/** Between two places, `share` of the way. */
export const mixed = (a: Vector, b: Vector, share: number): Vector => add(a, scaled(subtract(b, a), share));

/** Rotations of a pose (joints × 4, wxyz) between two poses, each along the shorter arc, `share` of the way. */
export function mixedTurns(a: Float32Array, b: Float32Array, share: number): Float32Array {
  const mixed = new Float32Array(a.length);
  for (let joint = 0; 4 * joint < a.length; joint++) {
    const [from, to] = [quaternionAt(a, joint), quaternionAt(b, joint)];
    const near = (1 - share) * Math.sign(from.reduce((sum, value, k) => sum + value * to[k], 0) || 1);
    mixed.set(normalized(to.map((value, k) => near * from[k] + share * value) as unknown as Quaternion), 4 * joint);
  }
  return mixed;
}

/** Index of the last of `count` increasing values that is at most `most`; 0 if all are larger, −1 if `count` is 0. */
export function lastIndex(count: number, valueAt: (index: number) => number, most: number): number {
  let [low, high] = [0, count - 1];
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (valueAt(middle) <= most) low = middle;
    else high = middle - 1;
  }
  return Math.min(low, high);
}

export function axisAngle(axis: Vector, angle: number): Quaternion {
  const sine = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * sine, axis[1] * sine, axis[2] * sine];
}

/** The turn about +Y in a rotation. */
export function heading([w, , y]: Quaternion): Quaternion {
  return Math.hypot(w, y) < 1e-9 ? UPRIGHT : normalized([w, 0, y, 0]);
}
