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

/** A way through the tree, as it changes with the coefficients of the space. */
interface Way {
  readonly mean: Float64Array; // (3) m, of the mean adult
  readonly slope: Float64Array; // (coefficients × 3) m
}

interface MeasuredWay extends Measured {
  readonly way: Way;
}

export class ShapeSpace {
  private readonly mean: Float64Array; // (points × 3) m
  private readonly components: Float64Array; // (coefficients × points × 3) m
  private readonly count: number; // of coefficients
  private readonly paths: readonly Uint8Array[]; // which points are on the way to a point
  private readonly ways = new Map<string, Way>(); // by start and end
  private readonly upright: Way; // from the floor to the crown, straight up

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
    const { mean, slope } = this.wayOf(Int8Array.from(this.up()));
    const vertical = (values: Float64Array): Float64Array => values.map((value, k) => (k % 3 === 1 ? value : 0));
    this.upright = { mean: vertical(mean), slope: vertical(slope) };
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
    const measured = (way: Way, { value, deviation }: Measured): MeasuredWay => ({
      way,
      value: value / scale,
      deviation: deviation / scale,
    });
    const ways = lengths.map((length) => measured(this.between(length.start, length.end), length));
    if (height) ways.push(measured(this.upright, height));
    const [coefficients, precision] = this.fitted(ways);
    const restOffset = this.offsets(coefficients);
    const deviation = this.deviations(restOffset, precision);
    return { restOffset: restOffset.map((x) => x * scale), deviation: deviation.map((x) => x * scale) };
  }

  // Twice a second in the time of a step: loops over numbers, without garbage.
  private fitted(measured: readonly MeasuredWay[]): [Float64Array, Float64Array[]] {
    const { count } = this;
    const coefficients = new Float64Array(count);
    const jacobian = new Float64Array(count);
    const vector = new Float64Array(3);
    let precision = identity(count);
    for (let turn = 0; turn < 20; turn++) {
      precision = identity(count);
      const gradient = coefficients.slice();
      for (const { way, value, deviation } of measured) {
        vector.set(way.mean);
        for (let k = 0; k < count; k++) {
          for (let c = 0; c < 3; c++) vector[c] += way.slope[3 * k + c] * coefficients[k];
        }
        const length = Math.max(Math.hypot(vector[0], vector[1], vector[2]), 1e-9);
        for (let k = 0; k < count; k++) jacobian[k] = along(way.slope, 3 * k, vector, 0) / length / deviation;
        for (let i = 0; i < count; i++) {
          gradient[i] += jacobian[i] * ((length - value) / deviation);
          for (let j = 0; j < count; j++) precision[i][j] += jacobian[j] * jacobian[i];
        }
      }
      const step = solve(
        precision.map((row) => row.slice()),
        gradient,
      );
      let largest = 0;
      for (let k = 0; k < count; k++) {
        coefficients[k] -= step[k];
        largest = Math.max(largest, Math.abs(step[k]));
      }
      if (largest < 1e-9) break;
    }
    return [coefficients, precision];
  }

  private offsets(coefficients: Float64Array): Float64Array {
    const offsets = this.mean.slice();
    for (let k = 0; k < this.count; k++) {
      const from = k * offsets.length;
      for (let at = 0; at < offsets.length; at++) offsets[at] += coefficients[k] * this.components[from + at];
    }
    return offsets;
  }

  /** Standard deviations of all bones' lengths, 0 for the root. */
  private deviations(offset: Float64Array, precision: readonly Float64Array[]): Float64Array {
    const { count, components } = this;
    const factor = cholesky(precision);
    const slope = new Float64Array(count);
    const deviations = new Float64Array(offset.length / 3);
    for (let point = 1; point < deviations.length; point++) {
      const at = 3 * point;
      const length = Math.max(Math.hypot(offset[at], offset[at + 1], offset[at + 2]), 1e-9);
      for (let k = 0; k < count; k++) slope[k] = along(components, k * offset.length + at, offset, at) / length;
      let sum = 0; // slope' precision^-1 slope is what the factor makes of it, squared
      for (const value of forward(factor, slope)) sum += value * value;
      deviations[point] = Math.sqrt(sum);
    }
    return deviations;
  }

  /** From one point of the T-pose to another. */
  private between(start: string, end: string): Way {
    const name = `${start} ${end}`;
    const known = this.ways.get(name);
    if (known) return known;
    const [a, b] = [start, end].map((point) => this.paths[this.skeleton.points.indexOf(point)]);
    const way = this.wayOf(Int8Array.from(b, (isOn, point) => isOn - a[point]));
    this.ways.set(name, way);
    return way;
  }

  /** `row`: how often each bone is passed, against its direction where negative. */
  private wayOf(row: Int8Array): Way {
    const sum = (offsets: Float64Array, from: number): number[] =>
      [0, 1, 2].map((c) => row.reduce((total, times, point) => total + times * offsets[from + 3 * point + c], 0));
    const size = this.mean.length;
    const slopes = Array.from({ length: this.count }, (_, k) => sum(this.components, k * size));
    return { mean: Float64Array.from(sum(this.mean, 0)), slope: Float64Array.from(slopes.flat()) };
  }

  private up(): Uint8Array {
    const path = this.paths[this.skeleton.points.indexOf("head_top")].slice();
    path[0] = 1;
    return path;
  }
}

/** The dot product of three numbers of two arrays. */
function along(a: Float64Array, i: number, b: Float64Array, j: number): number {
  return a[i] * b[j] + a[i + 1] * b[j + 1] + a[i + 2] * b[j + 2];
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
