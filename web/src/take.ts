/** A take: what was recorded between two presses, kept until the next one, also where its source is gone. */

import type { History, Moment } from "./history";

export class Take {
  moments: readonly Moment[] = [];
  private begun: number | null = null; // s, in the history

  constructor(private readonly history: History) {}

  get isRecording(): boolean {
    return this.begun !== null;
  }

  /** How long the take is, s. */
  get seconds(): number {
    const first = this.moments[0];
    const last = this.moments.at(-1);
    return first && last ? last.time - first.time : 0;
  }

  toggle(): void {
    if (this.begun === null) this.begun = this.history.last;
    else this.end();
  }

  /** End the recording, if there is one. */
  end(): void {
    if (this.begun === null) return;
    const moments = this.history.between(this.begun, this.history.last);
    this.begun = null;
    if (moments.length > 1) this.moments = moments;
  }

  /** What is saved: the take, or else the longest stretch of the history. */
  toSave(): readonly Moment[] {
    return this.moments.length > 1 ? this.moments : this.history.longestRun();
  }
}
