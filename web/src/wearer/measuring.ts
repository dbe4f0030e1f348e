/** Measuring the wearer: a countdown, two seconds of standing still, and a question if the result looks like a crouch. */

import { calibrated, LASTS } from "./calibration";
import type { Observation } from "../body/observation";
import type { Measurement } from "./wearer";

const COUNTDOWN = 3; // s to stand up straight
const LOWER = 0.12; // m under the highest head so far that looks like a crouch
const HEAD_OF_REACH = 0.97; // a standing head is 1.15 times as high as arms reach from wrist to wrist, 1.0 at least
const LOW = 1.28; // m: heads of standing adults are rarely lower
const AGAIN = 0.05; // m: a second low result this close to the first is accepted

export class Measuring {
  private frames: Observation[] | null = null;
  private began: number | null = null; // s, of the headset's clock
  private highest = 0; // m: of heads so far
  private doubted: number | null = null; // m: head height of the rejected result

  constructor(private readonly say: (text: string) => void) {}

  /** Begin with the next frame that has a head. */
  start(): void {
    this.frames = [];
    this.began = null;
  }

  /** Measure no more, as the headset is off. */
  stop(): void {
    this.frames = null;
  }

  /** Forget the rejected result, as the wearer may have changed. */
  forget(): void {
    this.highest = 0;
    this.doubted = null;
  }

  /** One frame of the headset: the result, once there is one. Throws an Error of one line if they cannot be. */
  take(frame: Observation): Measurement | null {
    const head = frame.points.find(({ name, position }) => name === "head" && position)?.position?.[1];
    if (head === undefined) return null;
    this.highest = Math.max(this.highest, head);
    const { frames } = this;
    if (!frames) return null;
    this.began ??= frame.time;
    const passed = frame.time - this.began - COUNTDOWN;
    if (passed < 0) {
      this.say(`Stand upright, arms out to the sides: ${Math.ceil(-passed)} …`);
      return null;
    }
    frames.push(frame);
    if (passed < LASTS) {
      this.say(`Hold still: ${Math.ceil(LASTS - passed)} …`);
      return null;
    }
    this.frames = null;
    return this.believed(calibrated(frames));
  }

  private believed(measured: Measurement): Measurement {
    const { head, reach } = measured;
    const isCrouch = head < this.highest - LOWER || (reach === null ? head < LOW : head < HEAD_OF_REACH * reach);
    const isSame = this.doubted !== null && Math.abs(head - this.doubted) < AGAIN;
    this.doubted = isCrouch && !isSame ? head : null;
    if (this.doubted === null) return measured;
    throw new Error(
      `Your head is only ${head.toFixed(2)} m high: stand upright and measure again. If you do stand upright, measure once more.`,
    );
  }
}
