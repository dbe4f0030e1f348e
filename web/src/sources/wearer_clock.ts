/** The clock of a wearer's frames: it leaps where their motion starts afresh, and shortens pauses that they stood through. */

import { conjugate, distance, multiply, type Quaternion, type Vector } from "../body/math";
import type { Point } from "../body/observation";

const LEAP = 2; // s; more than the core's longest gap, after which it remembers no motion
const PAUSE = 0.5; // s without frames; longer pauses are shortened to this
const STAYED = { metres: 0.3, degrees: 60 } as const; // a head that moved further is not followed on one path

interface Head {
  readonly position: Vector; // m
  readonly rotation: Quaternion;
}

export class WearerClock {
  private shift = 0; // s, from the page's clock to this one
  private last: { seconds: number; head: Head | null } | null = null;

  /** The next frame is of another place. */
  leap(): void {
    this.shift += LEAP;
    this.last = null;
  }

  /** The time of a frame, s. `seconds`: the page's clock. */
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
  return distance(before.position, now.position) < STAYED.metres && degrees < STAYED.degrees;
}
