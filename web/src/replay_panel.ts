/** The recording that the server replays: where in it we are, and going elsewhere. */

import type { Moment } from "./history";
import { button, element, input } from "./page";
import type { Replay } from "./protocol";

export class ReplayPanel {
  private isHeld = false;

  constructor(steer: (change: Omit<Replay, "type">) => void) {
    const place = input("replay-time");
    place.onchange = () => steer({ time: Number(place.value) });
    place.onpointerdown = () => (this.isHeld = true);
    place.onpointerup = place.onpointercancel = () => (this.isHeld = false);
    button("replay-begin").onclick = () => steer({ time: 0 });
  }

  /** `length` (s) of the recording; null: none is replayed. */
  offer(length: number | null): void {
    element("replay-panel").hidden = length === null;
    input("replay-time").max = String(length ?? 0);
  }

  show(moment: Moment): void {
    if (this.isHeld || element("replay-panel").hidden) return;
    const place = input("replay-time");
    place.value = String(moment.pose.time);
    place.setAttribute("aria-valuetext", `${moment.pose.time.toFixed(1)} s of ${Number(place.max).toFixed(1)} s`);
  }
}
