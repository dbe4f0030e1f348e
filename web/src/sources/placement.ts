/** Transformation from a device's world to the body's: body = Ry(heading) · device + offset. */

import { add, conjugate, heading, multiply, rotate, type Quaternion, type Vector } from "../body/math";
import type { Point } from "../body/observation";

export interface Placement {
  readonly turn: Quaternion; // about +Y
  readonly offset: Vector; // m
}

export const UNMOVED: Placement = { turn: [1, 0, 0, 0], offset: [0, 0, 0] };

/** Return the placement that puts a head in the middle, facing +Z, raised by `lift` m. */
export function placementAt(position: Vector, rotation: Quaternion, lift = 0): Placement {
  const turn = conjugate(heading(rotation));
  const [x, , z] = rotate(turn, position);
  return { turn, offset: [-x, lift, -z] };
}

/** Transform points into the body's world. */
export function applyPlacement(points: readonly Point[], { turn, offset }: Placement): Point[] {
  return points.map((point) => ({
    ...point,
    position: point.position ? add(rotate(turn, point.position), offset) : null,
    rotation: point.rotation ? multiply(turn, point.rotation) : null,
  }));
}
