/** Vectors and wxyz quaternions of one body: small arrays, double precision. */

import type { Quaternion, Vector } from "@bodysense/core";

export type { Quaternion, Vector } from "@bodysense/core";

export const UPRIGHT: Quaternion = [1, 0, 0, 0];

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

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scaled = (a: Vector, by: number): Vector => [a[0] * by, a[1] * by, a[2] * by];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const size = (a: Vector): number => Math.hypot(...a);
export const distance = (a: Vector, b: Vector): number => size(subtract(a, b));

export function cross(a: Vector, b: Vector): Vector {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}

export function unit(a: Vector): Vector {
  return scaled(a, 1 / Math.max(size(a), 1e-12));
}

export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}

export const conjugate = ([w, x, y, z]: Quaternion): Quaternion => [w, -x, -y, -z];

export function normalized(q: Quaternion): Quaternion {
  const length = Math.max(Math.hypot(...q), 1e-12);
  return [q[0] / length, q[1] / length, q[2] / length, q[3] / length];
}

/** Between two places, `share` of the way. */
export const mixed = (a: Vector, b: Vector, share: number): Vector => add(a, scaled(subtract(b, a), share));

/** Between two rotations along the shorter arc, `share` of the way. */
export function mixedTurn(a: Quaternion, b: Quaternion, share: number): Quaternion {
  const near = (1 - share) * Math.sign(a.reduce((sum, value, k) => sum + value * b[k], 0) || 1);
  return normalized(b.map((value, k) => near * a[k] + share * value) as unknown as Quaternion);
}

export function rotate([w, x, y, z]: Quaternion, v: Vector): Vector {
  const t = scaled(cross([x, y, z], v), 2);
  return add(add(v, scaled(t, w)), cross([x, y, z], t));
}

export function axisAngle(axis: Vector, angle: number): Quaternion {
  const sine = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * sine, axis[1] * sine, axis[2] * sine];
}

/** The rotation of a rotation vector, rad. */
export function exponential(vector: Vector): Quaternion {
  const angle = size(vector);
  return angle < 1e-12 ? UPRIGHT : axisAngle(scaled(vector, 1 / angle), angle);
}

/** The rotation whose matrix has these columns: right-handed, of length one. */
export function fromAxes(x: Vector, y: Vector, z: Vector): Quaternion {
  const trace = x[0] + y[1] + z[2];
  const w = Math.sqrt(Math.max(0, 1 + trace)) / 2;
  const candidates: Quaternion[] = [
    [4 * w * w, y[2] - z[1], z[0] - x[2], x[1] - y[0]],
    [y[2] - z[1], 1 + x[0] - y[1] - z[2], x[1] + y[0], z[0] + x[2]],
    [z[0] - x[2], x[1] + y[0], 1 - x[0] + y[1] - z[2], y[2] + z[1]],
    [x[1] - y[0], z[0] + x[2], y[2] + z[1], 1 - x[0] - y[1] + z[2]],
  ];
  const best = candidates.reduce((a, b) => (Math.hypot(...b) > Math.hypot(...a) ? b : a));
  const q = normalized(best);
  return q[0] < 0 ? [-q[0], -q[1], -q[2], -q[3]] : q;
}

/** The shortest rotation from one direction to another. */
export function between(from: Vector, to: Vector): Quaternion {
  const [a, b] = [unit(from), unit(to)];
  const cosine = dot(a, b);
  if (cosine < -0.999999) {
    const across = Math.abs(a[0]) < 0.9 ? cross(a, [1, 0, 0]) : cross(a, [0, 1, 0]);
    return axisAngle(unit(across), Math.PI);
  }
  const [x, y, z] = cross(a, b);
  return normalized([1 + cosine, x, y, z]);
}

/** The turn about +Y in a rotation. */
export function heading([w, , y]: Quaternion): Quaternion {
  return Math.hypot(w, y) < 1e-9 ? UPRIGHT : normalized([w, 0, y, 0]);
}
