/** A motion that plays again and again, seen by simulated sensors. */

import { bodyAt, duration, observe, SENSOR_SETS, type Clip, type SensorSet } from "../body/clip";
import type { Sink, Source } from "./source";

const REST = 2; // s between two rounds, after which motion starts afresh

export class ClipSource implements Source {
  private began: number | null = null; // ms
  private shownUntil = 0; // s
  isPlaying = true;

  constructor(
    readonly clip: Clip,
    private readonly sink: Sink,
    public set: SensorSet,
    readonly title: string,
    readonly guide: string | undefined = undefined,
  ) {}

  get sensors(): readonly string[] {
    return SENSOR_SETS[this.set];
  }

  frame(milliseconds: number): void {
    this.began ??= milliseconds - 1;
    const time = (milliseconds - this.began) / 1000;
    const length = duration(this.clip);
    const round = Math.floor(time / length);
    if (time <= this.shownUntil) return;
    this.shownUntil = time;
    const body = bodyAt(this.clip, time - round * length);
    this.sink.track(observe(body, this.clip.skeleton, this.sensors, time + round * REST), body);
  }

  stop(): void {
    this.began = null;
  }
}
