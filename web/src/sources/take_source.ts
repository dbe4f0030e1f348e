/** A take played in a loop, from the start to the end of its cut. */

import type { Playback } from "../takes/playback";
import { partOf, type Take } from "../takes/takes";
import type { Source } from "./source";

export class TakeSource implements Source {
  readonly guide = "This is a take: name it, cut it and save it in the list. The timeline holds all of it.";
  readonly sensors: readonly string[] = [];

  /** `take`: as its name and part are now. */
  constructor(
    private readonly take: () => Take,
    private readonly playback: Playback,
  ) {}

  get title(): string {
    return this.take().name;
  }

  /** Restart at the end of the cut. */
  frame(): void {
    const { playback } = this;
    const [from, to] = partOf(this.take());
    if (playback.playing && (playback.live || playback.time > to || playback.time < from)) playback.seek(from);
  }
}
