/** The line at the top, and the line under the view's settings: what is measured, and how fast the answers come. */

import type { History, Moment } from "./history";
import { element } from "./page";

const WINDOW = 1; // s that the rate is counted over
const NAMED = 4; // points

export class Status {
  begin(hasSignal: boolean): void {
    if (hasSignal && element("rate").textContent) return; // a welcome again, amid frames
    this.say(
      hasSignal
        ? "Connected · waiting for the signal"
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
    this.say(`Connected · ${measuredText(history.skeleton.points, moment.pose.hidden)}`); // spoken where it changes
    const time = `${(moment.pose.microseconds / 1000).toFixed(1)} ms in the server`;
    element("rate").textContent = [rate, time].filter(Boolean).join(" · ");
    element("shown").textContent = shownText(history, moment);
  }

  private say(text: string): void {
    const line = element("status");
    if (line.textContent !== text) line.textContent = text;
  }
}

/** What of the body is measured, in words where it is little. */
export function measuredText(points: readonly string[], hidden: Uint8Array | null): string {
  const measured = points.filter((_, point) => (hidden?.[point] ?? 255) < 128);
  if (measured.length === 0) return "nothing is measured";
  if (measured.length > NAMED) return `${measured.length} points measured`;
  return `${measured.map((name) => name.replaceAll("_", " ")).join(", ")} measured`;
}

function shownText(history: History, { pose, expected, error }: Moment): string {
  const { joints } = history.skeleton;
  const hidden = pose.hidden ? pose.hidden.subarray(0, joints).reduce((sum, value) => sum + Number(value > 127), 0) : 0;
  const parts = [`${hidden} of ${joints} joints hidden`, `expected error ${(100 * expected).toFixed(1)} cm`];
  if (error !== null) parts.push(`true error ${(100 * error).toFixed(1)} cm`);
  return parts.join(" · ");
}
