/** Calibration: measures head height and arm reach in two seconds of standing upright with the arms out. */

import { distance, type Vector } from "../body/math";
import type { Observation } from "../body/observation";
import { isWithin, REACHES, type Measurement } from "./wearer";

export const LASTS = 2; // s
const STILL = 0.05; // m: largest movement of the head of a person standing still
const FEWEST = 3; // frames: a device that can hardly keep up is measured, too

/** Measure a person standing still. Throws an Error of one line if the head moved or was not tracked. */
export function calibrated(frames: readonly Observation[]): Measurement {
  const heads = frames.flatMap(({ points }) =>
    points.filter(({ name, position }) => name === "head" && position).map(({ position }) => position as Vector),
  );
  if (heads.length < FEWEST) throw new Error("Your head was not tracked: put the headset on and measure again.");
  const middle = [0, 1, 2].map((k) => median(heads.map((head) => head[k]))) as unknown as Vector;
  const shift = Math.max(...heads.map((head) => distance(head, middle)));
  if (shift > STILL)
    throw new Error(
      `Your head moved by ${(100 * shift).toFixed(0)} cm: stand still for two seconds and measure again.`,
    );
  const spans = frames.flatMap(({ points }) => {
    const [left, right] = ["left_wrist", "right_wrist"].map(
      (name) => points.find((point) => point.name === name)?.position,
    );
    return left && right ? [distance(left, right)] : [];
  });
  const reach = spans.length > 0 ? median(spans) : 0;
  return { head: middle[1], reach: isWithin(reach, REACHES) ? reach : null }; // hanging arms give no reach
}

function median(values: readonly number[]): number {
  const sorted = [...values].sort((a, b) => a - b);
  return sorted[sorted.length >> 1];
}
