/** The observation of one frame: named points of the body, world frame (+Y up, metres). */

export type { Observation, Point } from "@bodysense/core";

/** Expected errors of positions by kind of device, m. */
export const ACCURACY = { exact: 0.001, headset: 0.001, tracker: 0.01, landmark: 0.05 } as const;
