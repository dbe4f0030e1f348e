/** A take: the frames between two presses, kept until the next take, even after its source is gone. */

import type { BodyFrame, History, Moment } from "./history";

/** Keeps frames of a take over a reload. */
export interface Keeper {
  /** More frames of a take; the first ones end what was kept before. */
  add(frames: readonly BodyFrame[], isFirst: boolean): void;
}

const KEPT_AT_A_TIME = 300; // frames: what a page that dies loses at most
const GROWN = 1e-4; // m: offsets that differ by less are one
export const LONGEST_TAKE = 100_000; // frames: 23 minutes at 72 Hz, about 90 MB

export class Take {
  frames: readonly BodyFrame[] = [];
  private recorded: BodyFrame[] | null = null;
  private kept = 0; // frames of it

  constructor(
    private readonly history: History,
    private readonly keeper: Keeper = { add: () => undefined },
  ) {
    history.added = (moment) => this.add(moment);
  }

  get isRecording(): boolean {
    return this.recorded !== null;
  }

  /** How long the take is, s. */
  get seconds(): number {
    const first = this.frames[0];
    const last = this.frames.at(-1);
    return first && last ? last.time - first.time : 0;
  }

  toggle(): void {
    if (this.recorded) {
      this.end();
      return;
    }
    this.recorded = [];
    this.kept = 0;
    const last = this.history.moments.at(-1);
    if (last) this.add(last);
  }

  /** End the recording, if there is one. */
  end(): void {
    const { recorded } = this;
    this.recorded = null;
    if (!recorded || recorded.length < 2) return;
    this.keep(recorded);
    this.frames = recorded;
  }

  /** A take that was kept. */
  restore(frames: readonly BodyFrame[]): void {
    if (frames.length > 1 && this.frames.length === 0) this.frames = frames;
  }

  /** Return the frames to save: the take, or else the longest stretch of the history. */
  toSave(): readonly BodyFrame[] {
    return this.frames.length > 1 ? this.frames : this.history.longestRun();
  }

  private add({ time, rootPosition, rotation, restOffset }: Moment): void {
    const { recorded } = this;
    if (!recorded) return;
    const before = recorded.at(-1)?.restOffset;
    const isSame = before?.every((value, k) => Math.abs(value - restOffset[k]) < GROWN);
    recorded.push({ time, rootPosition, rotation, restOffset: isSame && before ? before : restOffset });
    if (recorded.length - this.kept >= KEPT_AT_A_TIME) this.keep(recorded);
    if (recorded.length >= LONGEST_TAKE) this.end();
  }

  private keep(recorded: readonly BodyFrame[]): void {
    this.keeper.add(recorded.slice(this.kept), this.kept === 0);
    this.kept = recorded.length;
  }
}
