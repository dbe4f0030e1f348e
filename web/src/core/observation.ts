/** What was tracked in one frame: named points of the body, world frame (+Y up, metres). */

import type { Quaternion, Vector } from "./math";

export interface Point {
  readonly name: string; // a joint or an end site
  readonly position: Vector | null;
  readonly rotation: Quaternion | null; // world ← point
  readonly accuracy: number; // m, expected error of the position
}

export interface Observation {
  readonly time: number; // s, increasing
  readonly points: readonly Point[];
}

/** Expected errors of positions by kind of device, m. */
export const ACCURACY = { exact: 0.001, headset: 0.001, camera: 0.01, tracker: 0.01, landmark: 0.05 } as const;
