/** The line at the top, and the line under the view's settings: what completes the body, and how fast. */

import type { History, Moment } from "./history";
import { element } from "./page";
import type { Welcome } from "./protocol";

const WINDOW = 1; // s that the rate is counted over

export class Status {
  private profiles: readonly string[] = [];

  begin(welcome: Welcome, hasSignal: boolean): void {
    this.profiles = welcome.profiles;
    if (hasSignal && element("rate").textContent) return; // a welcome again, amid frames
    this.say(
      hasSignal
        ? `Connected · ${welcome.profile} · waiting for the signal`
        : "Connected, but the server plays nothing: start `bodysense serve --replay FILE`, or open this page on a headset.",
    );
  }

  lost(isRetrying: boolean): void {
    element("rate").textContent = "";
    this.say(isRetrying ? "Connecting again…" : "Not connected");
  }

  /** `moment` is the one that is shown. */
  show(history: History, moment: Moment): void {
    const since = history.indexAt(history.last - WINDOW);
    const count = history.moments.length - 1 - since;
    const seconds = history.last - (history.moments[since]?.time ?? history.last);
    const rate = seconds > 0 ? `${Math.round(count / seconds)} Hz` : "";
    const profile = this.profiles[moment.pose.profile] ?? "";
    this.say(`Connected · ${profile}`); // spoken where it changes; the figures beside it are not
    const time = `${(moment.pose.microseconds / 1000).toFixed(1)} ms in the server`;
    element("rate").textContent = [rate, time].filter(Boolean).join(" · ");
    element("shown").textContent = shownText(history, moment);
  }

  private say(text: string): void {
    const line = element("status");
    if (line.textContent !== text) line.textContent = text;
  }
}

function shownText(history: History, { pose, expected, error }: Moment): string {
  const { joints } = history.skeleton;
  const hidden = pose.hidden ? pose.hidden.subarray(0, joints).reduce((sum, value) => sum + Number(value > 127), 0) : 0;
  const parts = [`${hidden} of ${joints} joints hidden`, `expected error ${(100 * expected).toFixed(1)} cm`];
  if (error !== null) parts.push(`true error ${(100 * error).toFixed(1)} cm`);
  return parts.join(" · ");
}
