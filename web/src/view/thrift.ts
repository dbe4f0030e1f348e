/** Fewer pixels and no shadows on a device that cannot keep up. */

import type { WebGLRenderer } from "three";

const SLOW = 45; // ms a frame
const FRAMES = 20; // that are averaged before anything is given up,
const [FEW, SECONDS] = [3, 1.2]; // or as few as these, where they took so long

export class Thrift {
  private count = 0;
  private sum = 0;
  private last = 0;
  private readonly steps: (() => void)[];

  constructor(renderer: WebGLRenderer) {
    this.steps = [
      () => (renderer.shadowMap.enabled = false),
      () => renderer.setPixelRatio(Math.min(renderer.getPixelRatio(), 1)),
      () => renderer.setPixelRatio(0.6),
      () => renderer.setPixelRatio(0.4),
    ];
  }

  /** To be called once a frame, with its time (ms); true where something was given up. */
  frame(milliseconds: number): boolean {
    const took = milliseconds - this.last;
    this.last = milliseconds;
    if (took > 5000) return false; // the page was hidden, or the computer slept
    this.sum += took;
    this.count += 1;
    if (this.count < FRAMES && !(this.count >= FEW && this.sum > 1000 * SECONDS)) return false;
    const isSlow = this.sum / this.count > SLOW;
    this.sum = this.count = 0;
    const step = isSlow ? this.steps.shift() : undefined;
    step?.();
    return step !== undefined;
  }
}
