/** The wearer: height, measuring, sitting, the floor. */

import type { Settings } from "../settings";
import { button, element, input, tick } from "../page";

const HINT = element("calibrate-hint").textContent;

export interface YouEvents {
  height(metres: number | null): void;
  measure(): void;
  forget(): void;
  recentre(): void;
  sit(isSeated: boolean): void;
  holdFeet(isHeld: boolean): void;
}

export class YouPanel {
  constructor(settings: Settings, events: YouEvents) {
    const field = input("height");
    this.show(settings);
    field.onchange = () => events.height(field.value.trim() === "" ? null : Number(field.value));
    button("calibrate").onclick = () => events.measure();
    button("forget").onclick = () => events.forget();
    button("recentre").onclick = () => events.recentre();
    tick("seated", false, (isSeated) => events.sit(isSeated));
    tick("hold-feet", settings.holdFeet, (isHeld) => events.holdFeet(isHeld));
  }

  show({ height, measured }: Pick<Settings, "height" | "measured">): void {
    input("height").value = height === null ? "" : height.toFixed(2);
    button("forget").hidden = measured === null;
    const reach = measured?.reach ? `, arms ${measured.reach.toFixed(2)} m from wrist to wrist` : "";
    element("calibrate-hint").textContent = measured
      ? `You are measured: head ${measured.head.toFixed(2)} m high${reach}. Kept in this browser.`
      : HINT;
  }

  showSeated(isSeated: boolean): void {
    input("seated").checked = isSeated;
  }
}
