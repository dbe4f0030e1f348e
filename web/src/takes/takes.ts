/** Takes: recorded frames, each take with a name and an optional cut. They outlive their sources. */

import type { BodyFrame, History, Moment } from "./history";

export interface Take {
  readonly id: number; // ms since 1970, when it began
  readonly name: string;
  readonly frames: readonly BodyFrame[];
  readonly part: readonly [number, number] | null; // s since its first frame; null: the whole
}

/** Name and cut of a take. */
export type Description = Pick<Take, "id" | "name" | "part">;

/** Keeps takes over a reload. */
export interface Keeper {
  add(id: number, frames: readonly BodyFrame[]): void;
  describe(description: Description): void;
  remove(id: number): void;
}

const NOWHERE: Keeper = { add: () => undefined, describe: () => undefined, remove: () => undefined };
const KEPT_AT_A_TIME = 300; // frames between two writes: a page that crashes loses no more
const GROWN = 1e-4; // m: offsets that differ by less are treated as equal
export const LONGEST_TAKE = 100_000; // frames: 23 minutes at 72 Hz, about 90 MB

/** The cut of a take, s since its first frame. */
export function partOf({ frames, part }: Take): readonly [number, number] {
  return part ?? [0, frames[frames.length - 1].time - frames[0].time];
}

export class Takes {
  all: readonly Take[] = []; // in the order of their recording
  chosen: Take | null = null;
  private recorded: BodyFrame[] | null = null;
  private id = 0;
  private kept = 0; // frames of the take that are stored

  constructor(
    private readonly history: History,
    private readonly keeper: Keeper = NOWHERE,
    private readonly now: () => number = Date.now,
  ) {
    history.added = (moment) => this.add(moment);
  }

  get isRecording(): boolean {
    return this.recorded !== null;
  }

  toggle(): void {
    if (this.recorded) {
      this.end();
      return;
    }
    this.recorded = [];
    this.id = Math.max(this.now(), (this.all.at(-1)?.id ?? 0) + 1);
    this.kept = 0;
    const last = this.history.moments.at(-1);
    if (last) this.add(last);
  }

  /** End the recording, if there is one; a single frame is dropped. */
  end(): void {
    const { recorded, id } = this;
    this.recorded = null;
    if (!recorded || recorded.length < 2) return;
    this.keep(recorded);
    const numbers = this.all.map(({ name }) => Number(/^Take (\d+)$/.exec(name)?.[1] ?? 0));
    this.chosen = { id, name: `Take ${Math.max(0, ...numbers) + 1}`, frames: recorded, part: null };
    this.all = [...this.all, this.chosen];
    this.keeper.describe(this.chosen);
  }

  /** Add takes of earlier visits. */
  restore(takes: readonly Take[]): void {
    this.all = [...takes, ...this.all];
    this.chosen ??= takes.at(-1) ?? null;
  }

  choose(id: number): void {
    this.chosen = this.all.find((take) => take.id === id) ?? null;
  }

  /** Change name or cut of a take. */
  describe(id: number, change: Partial<Pick<Take, "name" | "part">>): void {
    this.all = this.all.map((take) => (take.id === id ? { ...take, ...change } : take));
    this.choose(id);
    if (this.chosen) this.keeper.describe(this.chosen);
  }

  remove(id: number): void {
    this.all = this.all.filter((take) => take.id !== id);
    if (this.chosen?.id === id) this.chosen = this.all.at(-1) ?? null;
    this.keeper.remove(id);
  }

  /** Return the frames to save: the part of the chosen take, or else the longest stretch of the history. */
  toSave(): readonly BodyFrame[] {
    const { chosen } = this;
    if (!chosen) return this.history.longestRun();
    const [from, to] = partOf(chosen);
    const begin = chosen.frames[0].time;
    return chosen.frames.filter(({ time }) => time - begin >= from && time - begin <= to);
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
    this.keeper.add(this.id, recorded.slice(this.kept));
    this.kept = recorded.length;
  }
}
