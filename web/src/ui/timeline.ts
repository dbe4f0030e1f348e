/** The timeline's buttons and slider; they steer the playback. */

import type { History } from "../takes/history";
import { button, choice, element, input } from "../page";
import type { Playback } from "../takes/playback";

export class Timeline {
  private isHeld = false; // the user drags the slider

  constructor(
    private readonly playback: Playback,
    private readonly history: History,
  ) {
    button("play").onclick = () => playback.toggle();
    button("live").onclick = () => playback.goLive();
    button("back").onclick = () => this.step(-1);
    button("forth").onclick = () => this.step(1);
    const scrub = input("scrub");
    scrub.oninput = () => playback.seek(Number(scrub.value));
    scrub.onpointerdown = () => (this.isHeld = true);
    scrub.onpointerup = scrub.onpointercancel = () => (this.isHeld = false);
    choice("speed", "1", (speed) => this.setSpeed(Number(speed)));
  }

  step(count: number): void {
    this.playback.stepFrames(this.history, count);
  }

  show(): void {
    const { playback, history } = this;
    const scrub = input("scrub");
    scrub.min = String(history.first);
    scrub.max = String(history.last);
    if (!this.isHeld) scrub.value = String(playback.time);
    const [time, length] = [playback.time, history.last].map((until) => (until - history.first).toFixed(1));
    scrub.setAttribute("aria-valuetext", `${time} of ${length} seconds`);
    element("clock").textContent = `${time} / ${length} s`;
    const play = button("play");
    play.dataset["state"] = playback.playing ? "playing" : "paused";
    play.setAttribute("aria-label", playback.playing ? "Pause" : "Play");
    button("live").setAttribute("aria-pressed", String(playback.live));
  }

  private setSpeed(speed: number): void {
    this.playback.speed = speed;
    if (speed !== 1 && this.playback.live) this.playback.seek(this.playback.time); // live runs at its own speed
  }
}
