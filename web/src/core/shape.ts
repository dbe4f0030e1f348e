/** The shape space: the likeliest proportions given a few lengths (bodysense.body.shape). */

import { cholesky, forward, solve } from "./math";
import { numbers, type Archive } from "./npz";
import type { Skeleton } from "./skeleton";

export const FLOOR = "floor";
const [SHORTEST, TALLEST] = [1.45, 2.05]; // m: adults of the space

/** A length and its standard deviation, m. */
export interface Measured {
  readonly value: number;
  readonly deviation: number;
}

/** A length between two points of the T-pose. */
export interface MeasuredLength extends Measured {
  readonly start: string;
  readonly end: string;
}

export interface Proportions {
  readonly restOffset: Float64Array; // (points × 3) m
  readonly deviation: Float64Array; // (points) m, standard deviation of each bone's length
}

export class ShapeSpace {
  private readonly mean: Float64Array; // (points × 3) m
  private readonly components: Float64Array; // (coefficients × points × 3) m
  private readonly count: number; // of coefficients
  private readonly paths: readonly Uint8Array[]; // which points are on the way to a point

  constructor(
    archive: Archive,
    private readonly skeleton: Skeleton,
  ) {
    const points = skeleton.points.length;
    this.mean = numbers(archive, "mean", [points, 3]).values;
    const components = numbers(archive, "components", [null, points, 3]);
    this.components = components.values;
    this.count = components.shape[0];
    this.paths = pathsOf(skeleton.parents);
  }

  /** Height of the crown over the floor, m. */
  stature(restOffset: ArrayLike<number>): number {
    const path = this.up();
    return path.reduce((sum, isOn, point) => sum + (isOn ? restOffset[3 * point + 1] : 0), 0);
  }

  /** Stature of somebody whose head joint stands so high, by the mean adult's proportions. */
  statureOfHead({ value, deviation }: Measured): Measured {
    const path = this.paths[this.skeleton.points.indexOf("head")];
    const joint = path.reduce((sum, isOn, point) => sum + (isOn ? this.mean[3 * point + 1] : 0), this.mean[1]);
    const ratio = this.stature(this.mean) / joint;
    return { value: value * ratio, deviation: deviation * ratio };
  }

  /** The likeliest body: the maximum a posteriori under the standard normal prior, by Gauss-Newton. */
  likeliest(lengths: readonly MeasuredLength[], height: Measured | null): Proportions {
    const scale = height ? height.value / Math.min(Math.max(height.value, SHORTEST), TALLEST) : 1;
    const rows: ArrayLike<number>[] = lengths.map(({ start, end }) => this.way(start, end));
    if (height) rows.push(this.up());
    const measured = [...lengths, ...(height ? [height] : [])].map(({ value, deviation }) => [
      value / scale,
      deviation / scale,
    ]);
    const vertical = height ? rows.length - 1 : -1;
    const [coefficients, precision] = this.fitted(rows, measured, vertical);
    const restOffset = this.offsets(coefficients);
    const deviation = this.deviations(restOffset, precision);
    return { restOffset: restOffset.map((x) => x * scale), deviation: deviation.map((x) => x * scale) };
  }

  private fitted(
    rows: readonly ArrayLike<number>[],
    measured: readonly number[][],
    vertical: number,
  ): [Float64Array, Float64Array[]] {
    const { count } = this;
    const start = rows.map((row, m) => this.vector(row, this.mean, 0, m === vertical));
    const slope = rows.map((row, m) =>
      Array.from({ length: count }, (_, k) => this.vector(row, this.components, k * this.mean.length, m === vertical)),
    );
    const coefficients = new Float64Array(count);
    let precision = identity(count);
    for (let turn = 0; turn < 20; turn++) {
      precision = identity(count);
      const gradient = coefficients.slice();
      rows.forEach((_, m) => {
        const vector = [0, 1, 2].map(
          (c) => start[m][c] + slope[m].reduce((sum, row, k) => sum + row[c] * coefficients[k], 0),
        );
        const length = Math.max(Math.hypot(...vector), 1e-9);
        const [value, deviation] = measured[m];
        const jacobian = slope[m].map(
          (row) => (row[0] * vector[0] + row[1] * vector[1] + row[2] * vector[2]) / length / deviation,
        );
        jacobian.forEach((a, i) => {
          gradient[i] += a * ((length - value) / deviation);
          jacobian.forEach((b, j) => (precision[i][j] += a * b));
        });
      });
      const step = solve(
        precision.map((row) => row.slice()),
        gradient,
      );
      step.forEach((value, k) => (coefficients[k] -= value));
      if (Math.max(...step.map(Math.abs)) < 1e-9) break;
    }
    return [coefficients, precision];
  }

  private offsets(coefficients: Float64Array): Float64Array {
    const size = this.mean.length;
    return this.mean.map((value, at) =>
      coefficients.reduce((sum, share, k) => sum + share * this.components[k * size + at], value),
    );
  }

  /** Standard deviations of all bones' lengths, 0 for the root. */
  private deviations(offset: Float64Array, precision: readonly Float64Array[]): Float64Array {
    const { count, components } = this;
    const factor = cholesky(precision);
    return Float64Array.from({ length: offset.length / 3 }, (_, point) => {
      if (point === 0) return 0;
      const at = 3 * point;
      const length = Math.max(Math.hypot(offset[at], offset[at + 1], offset[at + 2]), 1e-9);
      const slope = Float64Array.from({ length: count }, (_, k) => {
        const from = k * offset.length + at;
        return (
          (components[from] * offset[at] +
            components[from + 1] * offset[at + 1] +
            components[from + 2] * offset[at + 2]) /
          length
        );
      });
      return Math.hypot(...forward(factor, slope)); // slope' precision^-1 slope is what the factor makes of it, squared
    });
  }

  private vector(row: ArrayLike<number>, offsets: Float64Array, from: number, isVertical: boolean): number[] {
    const sum = [0, 0, 0];
    for (let point = 0; point < row.length; point++) {
      if (row[point] === 0) continue;
      for (let c = 0; c < 3; c++) sum[c] += row[point] * offsets[from + 3 * point + c];
    }
    return isVertical ? [0, sum[1], 0] : sum;
  }

  private way(start: string, end: string): Int8Array {
    const [a, b] = [start, end].map((name) => this.paths[this.skeleton.points.indexOf(name)]);
    return Int8Array.from(b, (isOn, point) => isOn - a[point]);
  }

  private up(): Uint8Array {
    const path = this.paths[this.skeleton.points.indexOf("head_top")].slice();
    path[0] = 1;
    return path;
  }
}

function pathsOf(parents: readonly number[]): Uint8Array[] {
  const paths: Uint8Array[] = [];
  parents.forEach((parent, point) => {
    const path = parent < 0 ? new Uint8Array(parents.length) : paths[parent].slice();
    if (parent >= 0) path[point] = 1;
    paths.push(path);
  });
  return paths;
}

function identity(count: number): Float64Array[] {
  return Array.from({ length: count }, (_, k) => Float64Array.from({ length: count }, (_, j) => (j === k ? 1 : 0)));
}
