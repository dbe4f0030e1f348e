/** MediaPipe's landmarks of a person, by the names of the body's parts. */

import { add, scaled, type Vector } from "../../body/math";
import type { Hands } from "./hands";

/** MediaPipe's 33 landmarks of one frame; axes of the camera: x to the right of the picture, y up, z to the camera. */
export interface Landmarks {
  readonly world: readonly Vector[]; // m, from between the hips
  readonly picture: readonly (readonly [number, number])[]; // heights of the picture, from its middle, y up
  readonly visible: readonly number[]; // probability
  readonly hands?: Hands | undefined;
}

export const MARKS = { nose: 0, left_ear: 7, right_ear: 8 } as const;
export const SIDES = ["left", "right"] as const;
export type Side = (typeof SIDES)[number];
const PARTS = ["shoulder", "elbow", "wrist", "pinky", "index", "thumb", "hip", "knee", "ankle", "heel", "toe"] as const;
export type Part = (typeof PARTS)[number];

export function mark(side: Side, part: Part): number {
  return 11 + 2 * PARTS.indexOf(part) + (side === "left" ? 0 : 1);
}

/** A part of both sides: places in the world, the point between them, and how sure the less sure one is. */
export function placesOf({ world, visible }: Landmarks, part: Part) {
  const marks = SIDES.map((side) => mark(side, part));
  const both = marks.map((k) => world[k]);
  return { both, middle: scaled(add(both[0], both[1]), 0.5), visible: Math.min(...marks.map((k) => visible[k])) };
}
