/** Clock of a wearer's frames: it jumps if the motion restarts, and shortens pauses in which the wearer stayed. */

import { conjugate, multiply, size, subtract } from "./math.js";
import type { Point, Quaternion, Vector } from "./types.js";

const PAUSE = 0.5; // s without frames; longer pauses are shortened to this
const STAYED = { metres: 0.3, degrees: 60 } as const; // a head that moved further in a pause restarts the motion

interface Head {
  readonly position: Vector; // m
  readonly rotation: Quaternion;
}

export class WearerClock {
  private shift = 0; // s, from the page's clock to this one
  private last: { seconds: number; head: Head | null } | null = null;

  /** `longestGap`: s, as in the settings of the person's state. */
  constructor(private readonly longestGap = 1) {}

  /** Restart the motion at the next frame. */
  leap(): void {
    this.shift += this.longestGap + 1;
    this.last = null;
  }

  /** Return the time of a frame, s. `seconds`: the page's clock. */
  time(seconds: number, head: Point | undefined): number {
    const seen = head?.position && head.rotation ? { position: head.position, rotation: head.rotation } : null;
    const { last } = this;
    if (last && seconds - last.seconds > PAUSE && last.head && seen && hasStayed(last.head, seen))
      this.shift -= seconds - last.seconds - PAUSE;
    this.last = { seconds, head: seen };
    return seconds + this.shift;
  }
}

function hasStayed(before: Head, now: Head): boolean {
  const [w] = multiply(conjugate(before.rotation), now.rotation);
  const degrees = (360 / Math.PI) * Math.acos(Math.min(1, Math.abs(w)));
  return size(subtract(before.position, now.position)) < STAYED.metres && degrees < STAYED.degrees;
}
