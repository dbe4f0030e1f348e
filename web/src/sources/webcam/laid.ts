/** A body laid along landmarks, from the pelvis. */

import type { Quaternion, Vector } from "../../body/math";

export class Laid {
  readonly rotation = new Map<string, Quaternion>();
  private readonly points = new Map<string, { readonly place: Vector; readonly visible: number }>();

  put(name: string, place: Vector, visible: number): void {
    this.points.set(name, { place, visible });
  }

  /** Where a point is, m from the pelvis. */
  at(name: string): Vector {
    return this.points.get(name)?.place ?? [0, 0, 0];
  }

  /** How probable it is that a point is visible. */
  visible(name: string): number {
    return this.points.get(name)?.visible ?? 0;
  }
}
