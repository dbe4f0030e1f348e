/** Status line: tracked points, speed and error of the completion. */

import { meanDistance, type Skeleton } from "../body/skeleton";
import type { Live } from "../live";
import type { Moment } from "../takes/history";
import { element } from "../page";

const FEWEST = 60; // bodies before a rate is displayed: the first ones are slow everywhere
const [SMOOTH, FLUENT] = [14, 33]; // ms: a picture at 72 and at 30 Hz

export function showStatus(live: Live, moment: Moment | null, skeleton: Skeleton, title: string): void {
  element("source").textContent = title;
  if (!moment) {
    element("summary").textContent = "";
    return;
  }
  if (moment.signal.length === 0 && !moment.expected) {
    element("summary").textContent = "Recorded before";
    element("rate").textContent = "";
    return;
  }
  const parts = [`${moment.signal.length} ${moment.signal.length === 1 ? "point" : "points"} tracked`];
  if (moment.truth) {
    const error = 100 * meanDistance(moment.body, moment.truth, Math.min(22, skeleton.joints));
    parts.push(`${error.toFixed(1)} cm from the truth`);
  } else if (moment.expected) {
    const expected = moment.expected.subarray(0, 22).reduce((sum, value) => sum + value, 0) / 22;
    parts.push(`${(100 * expected).toFixed(1)} cm expected error`);
  }
  element("summary").textContent = parts.join(" · ");
  if (live.times.length === 0) return;
  const slowest = live.quantile(0.99); // ms
  const pace = slowest <= SMOOTH ? "smoothly" : slowest <= FLUENT ? "nearly smoothly" : "slowly on this device";
  element("rate").textContent = live.times.length < FEWEST ? "completed here" : `completed here, ${pace}`;
}
