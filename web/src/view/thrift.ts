/** Fewer pixels, no shadows and fewer pictures on a device that cannot keep up. */

import type { WebGLRenderer } from "three";

const SLOW = 45; // ms a frame
const FRAMES = 20; // frames averaged before the quality is lowered
const [FEW, SECONDS] = [3, 1.2]; // frames and s: fewer frames suffice if they took this long
const [SMALL, SMALLEST] = [0.6, 0.4]; // pixels of the picture for one of the page
const SELDOM = 50; // ms between two pictures if the processor draws them, as it has other work

export class Thrift {
  private count = 0;
  private sum = 0;
  private last = 0;
  private drawn = 0; // ms
  private readonly steps: (() => void)[];

  /** `isFast`: a graphics card draws; without one nearly everything is given up at once. */
  constructor(
    renderer: WebGLRenderer,
    private readonly isFast: boolean,
  ) {
    renderer.shadowMap.enabled = isFast;
    if (!isFast) renderer.setPixelRatio(SMALL);
    this.steps = [
      () => (renderer.shadowMap.enabled = false),
      () => renderer.setPixelRatio(Math.min(renderer.getPixelRatio(), 1)),
      () => renderer.setPixelRatio(SMALL),
      () => renderer.setPixelRatio(SMALLEST),
    ].slice(isFast ? 0 : -1);
  }

  /** Whether a picture is due, at `milliseconds`. */
  isDue(milliseconds: number): boolean {
    if (!this.isFast && milliseconds - this.drawn < SELDOM) return false;
    this.drawn = milliseconds;
    return true;
  }

  /** Call once a frame with its time (ms). Returns true if the quality was lowered. */
  frame(milliseconds: number): boolean {
    const took = milliseconds - this.last;
    this.last = milliseconds;
    if (took > 5000) return false; // the page was hidden, or the computer slept
    this.sum += took;
    this.count += 1;
    if (this.count < FRAMES && !(this.count >= FEW && this.sum > 1000 * SECONDS)) return false;
    const isSlow = this.sum / this.count > (this.isFast ? SLOW : SLOW + SELDOM);
    this.sum = this.count = 0;
    const step = isSlow ? this.steps.shift() : undefined;
    step?.();
    return step !== undefined;
  }
}
