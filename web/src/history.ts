/** What was received, bounded: the timeline, the plots and the downloads read from here. */

import type { PoseFrame, SignalFrame } from "./protocol";
import { meanDistance, place, type Body, type Skeleton } from "./skeleton";

/** One answered frame, with what is plotted of it. */
export interface Moment {
  readonly time: number; // s, since the first; goes on where a replay jumps
  readonly pose: PoseFrame; // its time is the signal's, in a replay the place in the recording
  readonly body: Body;
  readonly truth: Body | null;
  readonly signal: SignalFrame | null;
  readonly expected: number; // m, mean expected error of the joints
  readonly error: number | null; // m, mean distance of the joints from the truth
  readonly roundTrip: number | null; // ms, from sending a signal to its answer; null for a spectator
  readonly isJump: boolean; // the signal's clock did not lead here from the moment before
}

const LIMIT = 12_000; // frames: over 3 minutes at 60 Hz, about 70 MB
const WAITING = 64; // signals and truths that wait for their pose
const LONGEST_STEP = 1; // s
const JUMP = 1 / 30; // s that a jump takes on the timeline

export class History {
  readonly moments: Moment[] = [];
  private readonly signals = new Map<number, SignalFrame>();
  private readonly truths = new Map<number, Body>();
  private readonly sent = new Map<number, number>();

  constructor(
    public skeleton: Skeleton, // its proportions may change; moments keep the place that they had
    private readonly limit: number = LIMIT,
  ) {}

  get first(): number {
    return this.moments[0]?.time ?? 0;
  }

  get last(): number {
    return this.moments.at(-1)?.time ?? 0;
  }

  /** A signal that will be answered; `sentAt` (ms) where this page sent it. */
  addSignal(signal: SignalFrame, sentAt?: number): void {
    remember(this.signals, signal.sequence, signal);
    if (sentAt !== undefined) remember(this.sent, signal.sequence, sentAt);
  }

  /** How the body truly stood; comes before the pose of the same sequence. */
  addTruth(truth: PoseFrame): void {
    remember(this.truths, truth.sequence, place(this.skeleton, truth.rootPosition, truth.rotation));
  }

  /** An answer, at `now` (ms). */
  addPose(pose: PoseFrame, now: number): void {
    const { joints } = this.skeleton;
    const before = this.moments.at(-1);
    const step = before ? pose.time - before.pose.time : 0;
    const isJump = before !== undefined && !(step > 0 && step < LONGEST_STEP);
    const body = place(this.skeleton, pose.rootPosition, pose.rotation);
    const truth = this.truths.get(pose.sequence) ?? null;
    const sentAt = this.sent.get(pose.sequence);
    this.moments.push({
      time: before ? before.time + (isJump ? JUMP : step) : 0,
      pose,
      body,
      truth,
      signal: this.signals.get(pose.sequence) ?? null,
      expected: pose.expectedError ? mean(pose.expectedError.subarray(0, joints)) : 0,
      error: truth && meanDistance(body, truth, joints),
      roundTrip: sentAt === undefined ? null : now - sentAt,
      isJump,
    });
    if (this.moments.length > this.limit) this.moments.splice(0, Math.ceil(this.limit / 10));
  }

  /** Index of the last moment at or before a time; 0 before the first, −1 while there is none. */
  indexAt(time: number): number {
    let [low, high] = [0, this.moments.length - 1];
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.moments[middle].time <= time) low = middle;
      else high = middle - 1;
    }
    return high < 0 ? -1 : low;
  }

  /** The longest stretch without a jump, the newest of the longest. */
  longestRun(): readonly Moment[] {
    const starts = [
      0,
      ...this.moments.flatMap(({ isJump }, index) => (isJump && index > 0 ? [index] : [])),
      this.moments.length,
    ];
    let best: [number, number] = [0, 0];
    for (let k = 0; k + 1 < starts.length; k++) {
      if (starts[k + 1] - starts[k] >= best[1] - best[0]) best = [starts[k], starts[k + 1]];
    }
    return this.moments.slice(...best);
  }
}

function remember<T>(map: Map<number, T>, key: number, value: T): void {
  map.set(key, value);
  const oldest = map.keys().next();
  if (map.size > WAITING && !oldest.done) map.delete(oldest.value);
}

function mean(values: Float32Array): number {
  return values.length ? values.reduce((sum, value) => sum + value, 0) / values.length : 0;
}
