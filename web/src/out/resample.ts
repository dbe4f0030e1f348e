/** The history at one even rate, as files of motion want it. */

import type { Clip } from "../body/clip";
import { mixed, mixedTurns, vectorAt } from "../body/math";
import type { BodyFrame } from "../takes/history";
import { LONGEST_TAKE } from "../takes/takes";

export type Motion = Pick<Clip, "rate" | "frames" | "root" | "rotation">;

/** Between two moments positions are interpolated linearly, rotations along the shorter arc. Needs two moments. */
export function resample(moments: readonly BodyFrame[], joints: number): Motion {
  const [first, last] = [moments[0].time, moments[moments.length - 1].time];
  const steps = moments.slice(1).map((moment, k) => moment.time - moments[k].time);
  steps.sort((a, b) => a - b);
  const rate = Math.min(Math.max(Math.round(1 / steps[steps.length >> 1]), 1), 240);
  const frames = Math.min(Math.floor((last - first) * rate + 1e-6) + 1, 2 * LONGEST_TAKE);
  const root = new Float32Array(3 * frames);
  const rotation = new Float32Array(4 * joints * frames);
  let before = 0;
  for (let frame = 0; frame < frames; frame++) {
    const time = first + frame / rate;
    while (before < moments.length - 2 && moments[before + 1].time <= time) before++;
    const [a, b] = [moments[before], moments[before + 1]];
    const share = Math.min(Math.max((time - a.time) / (b.time - a.time), 0), 1);
    root.set(mixed(vectorAt(a.rootPosition, 0), vectorAt(b.rootPosition, 0), share), 3 * frame);
    rotation.set(mixedTurns(a.rotation, b.rotation, share), 4 * joints * frame);
  }
  return { rate, root, rotation, frames };
}
