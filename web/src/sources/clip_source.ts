/** A motion, seen by simulated sensors. */

import { bodyAt, observe, SENSOR_SETS, type Clip, type SensorSet } from "../body/clip";
import type { Live } from "../live";
import { Rounds } from "./rounds";
import type { Source } from "./source";

export class ClipSource implements Source {
  readonly rounds: Rounds;

  constructor(
    readonly clip: Clip,
    private readonly live: Pick<Live, "track">,
    public set: SensorSet,
    readonly title: string,
    readonly guide: string | undefined = undefined,
    ended?: (clock: number) => void,
  ) {
    this.rounds = new Rounds((clip.frames - 1) / clip.rate, ended);
  }

  get sensors(): readonly string[] {
    return SENSOR_SETS[this.set];
  }

  frame(milliseconds: number): void {
    const { rounds } = this;
    if (!rounds.advance(milliseconds)) return;
    const body = bodyAt(this.clip, rounds.time);
    const seen = observe(body, this.clip.skeleton, this.sensors, rounds.clock(rounds.time));
    if (!this.live.track(seen, body)) rounds.again();
  }
}
