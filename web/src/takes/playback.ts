/** The displayed moment of the history: the newest, or one chosen on the timeline. */

import type { History, Moment } from "./history";

export class Playback {
  live = true;
  playing = true;
  speed = 1;
  time = 0; // s, in the history

  /** Advance by `seconds` of real time and return the moment to display. */
  step(history: History, seconds: number): Moment | null {
    if (this.live) this.time = history.last;
    else if (this.playing) this.time += seconds * this.speed;
    if (!this.live && this.time >= history.last) {
      this.time = history.last;
      this.live = this.playing && this.speed >= 1; // caught up with the source
    }
    this.time = Math.max(this.time, history.first);
    return history.moments[history.indexAt(this.time)] ?? null;
  }

  seek(time: number): void {
    this.live = false;
    this.time = time;
  }

  pause(): void {
    this.live = false;
    this.playing = false;
  }

  toggle(): void {
    if (this.playing) this.pause();
    else this.playing = true;
  }

  goLive(): void {
    this.live = true;
    this.playing = true;
  }

  /** Pause and show the frame `count` further; negative: back. */
  stepFrames(history: History, count: number): void {
    const index = history.indexAt(this.time) + count;
    this.pause();
    const moment = history.moments[Math.min(Math.max(index, 0), history.moments.length - 1)];
    if (moment) this.time = moment.time;
  }
}
