/** The wearer: height, measuring, sitting, the floor. */

import { calibrated, LASTS } from "../core/calibration";
import type { Observation } from "../core/observation";
import type { Person } from "../core/person";
import { button, input } from "../page";

export interface YouEvents {
  height(metres: number | null): void;
  measured(person: Person): void;
  recentre(): void;
  sit(isSeated: boolean): void;
  holdFeet(isHeld: boolean): void;
  say(text: string): void;
  fault(error: unknown): void;
}

export class YouPanel {
  private frames: Observation[] | null = null; // while somebody is measured

  constructor(
    height: number | null,
    holdFeet: boolean,
    private readonly events: YouEvents,
  ) {
    const field = input("height");
    field.value = height === null ? "" : height.toFixed(2);
    field.onchange = () => events.height(field.value.trim() === "" ? null : Number(field.value));
    button("calibrate").onclick = () => this.measure();
    button("recentre").onclick = () => events.recentre();
    const seated = input("seated");
    seated.onchange = () => events.sit(seated.checked);
    const hold = input("hold-feet");
    hold.checked = holdFeet;
    hold.onchange = () => events.holdFeet(hold.checked);
  }

  show(height: number | null): void {
    input("height").value = height === null ? "" : height.toFixed(2);
  }

  /** Measure the wearer as soon as their head is tracked. */
  measure(): void {
    this.frames = [];
    this.events.say("Stand upright, arms out to the sides. You are measured as soon as your head is tracked.");
  }

  /** One frame of the headset. */
  take(frame: Observation): void {
    const { frames } = this;
    if (!frames || !frame.points.some(({ name, position }) => name === "head" && position)) return;
    frames.push(frame);
    if (frame.time - (frames[0]?.time ?? 0) < LASTS) return;
    this.frames = null;
    try {
      this.events.measured(calibrated(frames));
      this.events.say("You are measured.");
    } catch (error) {
      this.events.fault(error);
    }
  }
}
