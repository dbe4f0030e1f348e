/** What is known of the wearer, and what was learned of their proportions (bodysense.completion.proportions). */

import type { Observation } from "./observation";
import { FLOOR, type Measured, type MeasuredLength, type Proportions, type ShapeSpace } from "./shape";
import type { Skeleton } from "./skeleton";

export interface Person {
  readonly height: Measured | null; // stature, m
  readonly head?: Measured; // m: how high the head joint stands, where the height is not told
  readonly lengths: readonly MeasuredLength[];
}

export const NOBODY: Person = { height: null, lengths: [] };
export const HEIGHTS = { least: 1.0, most: 2.3 } as const; // m
const TOLD = 0.001; // m: standard deviation of a length that somebody told
const [BIN, BINS] = [0.005, 480]; // m, and how many
const [SEATED, STANDING] = [1.28, 1.95]; // m: the head joint of somebody who stands is between them
const LOOK = 0.1; // s between two looks at lengths
const ENOUGH = 0.5; // s that a length must have been seen
const EVERY = 0.5; // s between two fits
const QUICK = 0.4; // s in which half of what the shown body lacks is made up
const VAGUE = 0.06; // m: points that err more together measure nothing

/** Somebody who told their height. Throws an Error of one line for a height that no person has. */
export function personOf(height: number | null): Person {
  if (height === null) return NOBODY;
  if (!(height >= HEIGHTS.least && height <= HEIGHTS.most)) {
    throw new Error(`A height of ${height} m is not a person's; give ${HEIGHTS.least} to ${HEIGHTS.most} m.`);
  }
  return { height: { value: height, deviation: TOLD }, lengths: [] };
}

interface Length {
  readonly start: string;
  readonly end: string; // or the floor
  readonly quantile: number; // of what is seen which is taken
  readonly deviation: number; // m
  readonly slack: number; // m by which the quantile falls short of the rest pose
}

const ofBoth = (start: string, end: string, quantile: number, deviation: number, slack = 0): Length[] =>
  ["left", "right"].map((side) => ({ start: `${side}_${start}`, end: `${side}_${end}`, quantile, deviation, slack }));

const LENGTHS: readonly Length[] = [
  ...ofBoth("shoulder", "elbow", 0.5, 0.006),
  ...ofBoth("elbow", "wrist", 0.5, 0.006),
  ...ofBoth("hip", "knee", 0.5, 0.006),
  ...ofBoth("knee", "ankle", 0.5, 0.006),
  ...ofBoth("ankle", "foot", 0.5, 0.006),
  ...ofBoth("wrist", "middle1", 0.5, 0.004),
  ...ofBoth("hip", "ankle", 0.95, 0.02, 0.01),
  ...ofBoth("shoulder", "wrist", 0.98, 0.03, 0.02),
  { start: "left_shoulder", end: "right_shoulder", quantile: 0.5, deviation: 0.01, slack: 0 },
  { start: "left_hip", end: "right_hip", quantile: 0.5, deviation: 0.006, slack: 0 },
  { start: "pelvis", end: "head", quantile: 0.95, deviation: 0.02, slack: 0.01 },
  { start: "head", end: FLOOR, quantile: 0.95, deviation: 0.03, slack: 0.01 },
];

/** The body that is shown, which grows toward the one that is believed so slowly that nothing jumps. */
export class Growing {
  readonly shown: Float64Array; // (points × 3) m
  private believed: Proportions;
  private readonly seconds = LENGTHS.map(() => new Float32Array(BINS)); // each length was in each bin
  private since = 0; // s since lengths were last looked at
  private due = 0; // s since beliefs were last brought up to date

  constructor(
    private readonly space: ShapeSpace,
    private readonly skeleton: Skeleton,
    private person: Person = NOBODY,
  ) {
    this.believed = space.likeliest(person.lengths, this.told);
    this.shown = this.believed.restOffset.slice();
  }

  private get told(): Measured | null {
    const { height, head } = this.person;
    return height ?? (head ? this.space.statureOfHead(head) : null);
  }

  get deviation(): Float64Array {
    return this.believed.deviation;
  }

  /** More was told; what was seen still counts. */
  tell(person: Person): void {
    this.person = person;
    this.believe();
  }

  /** One more frame: what was tracked, by point of the skeleton, `interval` s after the one before. */
  update(frame: TrackedPoints, interval: number, floor: number): void {
    this.since += interval;
    this.due += interval;
    if (this.since >= LOOK) {
      this.count(frame, floor);
      if (this.due >= EVERY) {
        this.believe();
        this.due = 0;
      }
      this.since = 0;
    }
    const share = 1 - 2 ** (-interval / QUICK);
    const { shown, believed } = this;
    for (let k = 0; k < shown.length; k++) shown[k] += share * (believed.restOffset[k] - shown[k]);
  }

  // Single precision throughout, as the library counts, so that a length falls into the same bin.
  private count({ position, hasPosition, accuracy }: TrackedPoints, floor: number): void {
    const passed = Math.min(this.since, 2 * LOOK);
    LENGTHS.forEach(({ start, end }, row) => {
      const a = this.skeleton.points.indexOf(start);
      const b = end === FLOOR ? a : this.skeleton.points.indexOf(end);
      if (!hasPosition[a] || !hasPosition[b] || !(Math.fround(accuracy[a] + accuracy[b]) < VAGUE)) return;
      const length = end === FLOOR ? Math.fround(position[3 * a + 1] - floor) : distance32(position, 3 * a, 3 * b);
      if (!(length > 0 && length < Math.fround(BIN * BINS))) return;
      const bin = Math.trunc(Math.fround(length / Math.fround(BIN)));
      this.seconds[row][bin] += passed;
    });
  }

  private believe(): void {
    let height = this.told;
    const seen = new Map<string, { start: string; end: string; values: number[]; deviations: number[] }>();
    LENGTHS.forEach(({ start, end, quantile, deviation, slack }, row) => {
      const total = sum32(this.seconds[row]);
      if (!(total > ENOUGH)) return;
      const value = (quantileOf(this.seconds[row], total, quantile) + 0.5) * BIN + slack;
      const unsure = deviation * (1 + 2 / (1 + total));
      if (end === FLOOR) {
        if (!this.told && value > SEATED && value < STANDING) {
          height = this.space.statureOfHead({ value, deviation: unsure });
        }
        return;
      }
      const isAcross = start.startsWith("left_") && end.startsWith("right_");
      const [from, to] = isAcross ? [start, end] : [start, end].map((name) => name.replace("right_", "left_"));
      const pair = seen.get(from + to) ?? { start: from, end: to, values: [], deviations: [] };
      pair.values.push(value);
      pair.deviations.push(unsure);
      seen.set(from + to, pair);
    });
    const mean = (values: readonly number[]) => values.reduce((sum, value) => sum + value, 0) / values.length;
    const told = this.person.lengths;
    const lengths = [...seen.values()]
      .filter(({ start, end }) => !told.some((length) => length.start === start && length.end === end))
      .map(({ start, end, values, deviations }) => ({ start, end, value: mean(values), deviation: mean(deviations) }));
    this.believed = this.space.likeliest([...lengths, ...told], height);
  }
}

/** One frame by point of the skeleton, as the graph reads it. */
export interface TrackedPoints {
  readonly position: Float32Array; // (points × 3) m, 0 where not tracked
  readonly rotation: Float32Array; // (joints × 4) wxyz, identity where not tracked
  readonly hasPosition: Uint8Array; // (points)
  readonly hasRotation: Uint8Array; // (joints)
  readonly accuracy: Float32Array; // (points) m
}

const ABSENT_ACCURACY = 0.001; // m, of points that are not tracked: any positive number

export function noPoints({ points, joints }: Skeleton): TrackedPoints {
  return {
    position: new Float32Array(3 * points.length),
    rotation: new Float32Array(4 * joints),
    hasPosition: new Uint8Array(points.length),
    hasRotation: new Uint8Array(joints),
    accuracy: new Float32Array(points.length),
  };
}

/** What was tracked in place of what was before. Points of an observation that the skeleton does not have are left out. */
export function fillPoints(tracked: TrackedPoints, { points }: Observation, skeleton: Skeleton): void {
  tracked.position.fill(0);
  tracked.rotation.fill(0);
  for (let joint = 0; joint < skeleton.joints; joint++) tracked.rotation[4 * joint] = 1;
  tracked.hasPosition.fill(0);
  tracked.hasRotation.fill(0);
  tracked.accuracy.fill(ABSENT_ACCURACY);
  for (const { name, position, rotation, accuracy } of points) {
    const point = skeleton.points.indexOf(name);
    if (point < 0) continue;
    if (position?.every(Number.isFinite)) {
      tracked.position.set(position, 3 * point);
      tracked.hasPosition[point] = 1;
      tracked.accuracy[point] = accuracy;
    }
    if (rotation?.every(Number.isFinite) && point < skeleton.joints) {
      tracked.rotation.set(rotation, 4 * point);
      tracked.hasRotation[point] = 1;
    }
  }
}

function distance32(position: Float32Array, a: number, b: number): number {
  let sum = 0;
  for (let k = 0; k < 3; k++) {
    const apart = Math.fround(position[a + k] - position[b + k]);
    sum = Math.fround(sum + Math.fround(apart * apart));
  }
  return Math.fround(Math.sqrt(sum));
}

function sum32(values: Float32Array): number {
  let sum = 0;
  for (let k = 0; k < values.length; k++) sum = Math.fround(sum + values[k]);
  return sum;
}

/** The bin at which a share of all seconds is reached. */
function quantileOf(seconds: Float32Array, total: number, quantile: number): number {
  let sum = 0;
  for (let bin = 0; bin < seconds.length; bin++) {
    sum = Math.fround(sum + seconds[bin]);
    if (Math.fround(sum / total) >= quantile) return bin;
  }
  return -1;
}
