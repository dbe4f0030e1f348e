/** Vectors and wxyz quaternions: small arrays, double precision. */

import type { Quaternion, Vector } from "./types.js";

export const UPRIGHT: Quaternion = [1, 0, 0, 0];

export const add = (a: Vector, b: Vector): Vector => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const subtract = (a: Vector, b: Vector): Vector => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scaled = (a: Vector, by: number): Vector => [a[0] * by, a[1] * by, a[2] * by];
export const dot = (a: Vector, b: Vector): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const size = (a: Vector): number => Math.hypot(...a);

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

export function rotate([w, x, y, z]: Quaternion, v: Vector): Vector {
  const t = scaled(cross([x, y, z], v), 2);
  return add(add(v, scaled(t, w)), cross([x, y, z], t));
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
