/** A recording of tracked points, played at its own speed. */

import { lastIndex } from "../body/math";
import type { Observation } from "../body/observation";
import type { Live } from "../live";
import { Rounds } from "./rounds";
import type { Source } from "./source";

export class RecordingSource implements Source {
  readonly guide = "The recorded points are completed again. Settings can switch some of them off.";
  readonly rounds: Rounds;
  private last = ""; // round and index of the frame that was given last

  constructor(
    private readonly frames: readonly Observation[],
    private readonly live: Pick<Live, "track">,
    readonly title: string,
    ended?: (clock: number) => void,
  ) {
    this.rounds = new Rounds(this.timeOf(frames.length - 1), ended);
  }

  get sensors(): readonly string[] {
    return this.frames[0]?.points.map(({ name }) => name) ?? [];
  }

  frame(milliseconds: number): void {
    const { rounds } = this;
    if (!rounds.advance(milliseconds)) return;
    // The newest frame that is due: a page that was hidden does not catch up.
    const index = lastIndex(this.frames.length, (frame) => this.timeOf(frame), rounds.time);
    const name = `${rounds.number}:${index}`;
    if (name === this.last) return;
    const time = rounds.clock(Math.max(this.timeOf(index), rounds.from));
    if (this.live.track({ ...this.frames[index], time }, null)) this.last = name;
    else rounds.again();
  }

  /** Seconds of a frame after the first. */
  private timeOf(index: number): number {
    return (this.frames[index]?.time ?? 0) - (this.frames[0]?.time ?? 0);
  }
}
