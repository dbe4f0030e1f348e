/** The completed bodies, up to a limit; the timeline and saved files read them. */

import { lastIndex } from "../body/math";
import type { Point } from "../body/observation";
import type { Body } from "../body/skeleton";

/** A frame of a body's motion, as files store it. */
export interface BodyFrame {
  readonly time: number; // s, since the first; continuous when its source jumps
  readonly rootPosition: Float32Array; // (3) m
  readonly rotation: Float32Array; // (joints × 4) wxyz, parent ← joint
  readonly restOffset: Float32Array; // (points × 3) m, of this frame
}

/** One completed frame. */
export interface Moment extends BodyFrame {
  readonly sourceTime: number; // s, of the source's own clock
  readonly body: Body;
  readonly signal: readonly Point[]; // tracked points, in the body's world
  readonly truth: Body | null;
  readonly expected: Float32Array | null; // (points) m, expected position error
  readonly measured: Uint8Array | null; // (points) 0 or 1
  readonly milliseconds: number; // that it took to complete
  readonly isJump: boolean; // the source's clock did not lead here from the moment before
}

const LIMIT = 12_000; // frames: over 3 minutes at 60 Hz, about 60 MB
const LONGEST_STEP = 1; // s
const JUMP = 1 / 30; // s that a jump takes on the timeline

export class History {
  readonly moments: Moment[] = [];
  added: (moment: Moment) => void = () => undefined; // called with each new moment

  constructor(readonly limit: number = LIMIT) {}

  get first(): number {
    return this.moments[0]?.time ?? 0;
  }

  get last(): number {
    return this.moments.at(-1)?.time ?? 0;
  }

  add(frame: Omit<Moment, "time" | "isJump">): void {
    const before = this.moments.at(-1);
    const step = before ? frame.sourceTime - before.sourceTime : 0;
    const isJump = before !== undefined && !(step > 0 && step < LONGEST_STEP);
    const moment = { ...frame, time: before ? before.time + (isJump ? JUMP : step) : 0, isJump };
    this.moments.push(moment);
    this.added(moment);
    if (this.moments.length > this.limit) this.moments.shift();
  }

  clear(): void {
    this.moments.length = 0;
  }

  /** Index of the last moment at or before a time; 0 before the first, −1 if there are no moments. */
  indexAt(time: number): number {
    return lastIndex(this.moments.length, (index) => this.moments[index].time, time);
  }

  /** The longest stretch without a jump, the newest of the longest. */
  longestRun(): readonly Moment[] {
    const starts = this.moments.flatMap(({ isJump }, index) => (isJump || index === 0 ? [index] : []));
    const runs = starts.map((start, k) => this.moments.slice(start, starts[k + 1]));
    return runs.reduce((best, run) => (run.length >= best.length ? run : best), []);
  }
}
