/** The clock: how long ago the frame before was, and whether what was remembered still counts. */

const LONGEST_GAP = 1; // s without frames after which motion starts afresh
const FIRST = 1 / 30; // s, the interval that a first frame counts as
const LONGEST = 0.1; // s: a longer interval that is no gap counts as this

export interface Interval {
  readonly seconds: number;
  readonly isFresh: boolean;
}

/** Throws an Error where time is no number or does not increase. `before` is NaN before the first frame. */
export function interval(time: number, before: number): Interval {
  const past = time - before;
  if (!Number.isFinite(time) || past <= 0) throw new Error(`A frame at ${time} s came after one at ${before} s.`);
  const isFresh = !(past <= LONGEST_GAP);
  return { seconds: isFresh ? FIRST : Math.min(past, LONGEST), isFresh };
}
