/** The clock of a motion: it plays, repeats, pauses and jumps. */

const REST = 2; // s added to observation times at a jump, so that the tracker restarts the motion
const LONGEST = 1; // s that one picture advances at most: a hidden page resumes at its last frame
const EARLY = 1e-3; // s: rounding of times
const STILL = 1; // s that a single frame takes

export class Rounds {
  isPlaying = true;
  repeats = true;
  time = 0; // s, in the motion
  readonly length: number; // s
  from = 0; // s: start of this round, in the motion
  number = 0; // of the round; every jump begins one
  private begun = 0; // s: the clock of observations when the motion's time is 0
  private before: number | null = null; // ms
  private isDue = true;

  /** `ended` gets the clock of observations at the end of the motion. */
  constructor(
    length: number, // s
    private readonly ended: (clock: number) => void = () => undefined,
  ) {
    this.length = length > 0 ? length : STILL;
  }

  /** Advance to `milliseconds` of the page's clock. Returns whether a frame is due. */
  advance(milliseconds: number): boolean {
    const passed = (milliseconds - (this.before ?? milliseconds)) / 1000;
    this.before = milliseconds;
    if (this.isPlaying && passed > 0) {
      this.isDue = true;
      this.time += Math.min(passed, LONGEST);
      if (this.time >= this.length) this.end();
    }
    const { isDue } = this;
    this.isDue = false;
    return isDue;
  }

  /** Ask for the frame again: it was left out. */
  again(): void {
    this.isDue = true;
  }

  play(repeats: boolean): void {
    this.repeats = repeats;
    if (!this.isPlaying && this.time >= this.length) this.seek(0);
    this.isPlaying = true;
  }

  pause(): void {
    this.isPlaying = false;
  }

  /** Go on at a time of the motion, s; the nearest that it has. */
  seek(time: number): void {
    this.begun = this.clock(this.time) + REST - Math.min(Math.max(time, 0), this.length);
    this.time = this.from = Math.min(Math.max(time, 0), this.length);
    this.number += 1;
    this.isDue = true;
  }

  /** The clock of observations at a time of this round, s. */
  clock(time: number): number {
    return this.begun + time;
  }

  /** The time in the motion at a clock of observations; null for one of an earlier round. */
  timeAt(clock: number): number | null {
    const time = clock - this.begun;
    return time < this.from - EARLY ? null : Math.max(time, 0);
  }

  private end(): void {
    this.time = this.length;
    this.ended(this.clock(this.length));
    if (this.repeats) this.seek(0);
    else this.isPlaying = false;
  }
}
