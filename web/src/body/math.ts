/** Vectors and wxyz quaternions of one body: the package's, and what the page alone needs. */

import { cross, dot, normalized, scaled, size, subtract, unit, UPRIGHT } from "@bodysense/core/math";
import type { Quaternion, Vector } from "@bodysense/core";

export * from "@bodysense/core/math";
export type { Quaternion, Vector } from "@bodysense/core";

export const distance = (a: Vector, b: Vector): number => size(subtract(a, b));

export function axisAngle(axis: Vector, angle: number): Quaternion {
  const sine = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * sine, axis[1] * sine, axis[2] * sine];
}

/** The rotation of a rotation vector, rad. */
export function exponential(vector: Vector): Quaternion {
  const angle = size(vector);
  return angle < 1e-12 ? UPRIGHT : axisAngle(scaled(vector, 1 / angle), angle);
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

/** Solve A·x = b for a symmetric positive A (n × n, in rows); both are overwritten. */
export function solve(matrix: Float64Array[], values: Float64Array): Float64Array {
  const n = values.length;
  for (let column = 0; column < n; column++) {
    const row = matrix[column];
    for (let below = column + 1; below < n; below++) {
      const share = matrix[below][column] / row[column];
      for (let k = column; k < n; k++) matrix[below][k] -= share * row[k];
      values[below] -= share * values[column];
    }
  }
  for (let row = n - 1; row >= 0; row--) {
    for (let k = row + 1; k < n; k++) values[row] -= matrix[row][k] * values[k];
    values[row] /= matrix[row][row];
  }
  return values;
}
