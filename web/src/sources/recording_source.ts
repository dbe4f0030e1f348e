/** A recording of what a device tracked, played at its own pace. */

import type { Observation } from "../body/observation";
import type { Sink, Source } from "./source";

const REST = 2; // s between two rounds

export class RecordingSource implements Source {
  readonly guide = "What the device tracked is completed anew; under Settings parts of it can be switched off.";
  private began: number | null = null; // ms
  private next = 0;
  private round = 0;

  constructor(
    private readonly frames: readonly Observation[],
    private readonly sink: Sink,
    readonly title: string,
  ) {}

  get sensors(): readonly string[] {
    return this.frames[0]?.points.map(({ name }) => name) ?? [];
  }

  frame(milliseconds: number): void {
    const first = this.frames[0]?.time ?? 0;
    this.began ??= milliseconds;
    const length = (this.frames.at(-1)?.time ?? 0) - first + REST;
    const time = (milliseconds - this.began) / 1000;
    let newest: Observation | null = null; // of those that are due: a page that was hidden does not catch up
    while (this.next < this.frames.length && this.frames[this.next].time - first + this.round * length <= time) {
      newest = this.frames[this.next++];
    }
    if (newest) this.sink.track({ ...newest, time: newest.time - first + this.round * length }, null);
    if (this.next >= this.frames.length && time > (this.round + 1) * length) {
      this.next = 0;
      this.round += 1;
    }
  }

  stop(): void {
    this.began = null;
  }
}
