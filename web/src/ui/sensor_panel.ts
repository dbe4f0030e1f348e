/** The panel of sensors: simulated ones, and parts of the body that can be switched off. */

import type { SensorSet } from "../body/clip";
import { choice, element } from "../page";

const PARTS: readonly (readonly [RegExp, string])[] = [
  [/^(headset|head|neck|head_top|nose)$/, "Head"],
  [/^(left|right)_(hip|knee|ankle|foot|toe)/, "$1 leg"],
  [/^(left|right)_(collar|shoulder|elbow)/, "$1 arm"],
  [/^(left|right)[_:]/, "$1 hand"],
];

export class SensorPanel {
  private offered = "";

  constructor(
    set: SensorSet,
    picked: (set: SensorSet) => void,
    private readonly hidden: (points: ReadonlySet<string>) => void,
  ) {
    choice("set", set, picked);
  }

  /** Offer the tracked parts of a source; `isSimulated`: its sensors may be chosen. */
  offer(points: readonly string[], isSimulated: boolean): void {
    element("set-row").hidden = !isSimulated;
    const parts = new Map<string, string[]>();
    for (const point of points) parts.set(partOf(point), [...(parts.get(partOf(point)) ?? []), point]);
    const names = [...parts.keys()].join();
    if (names === this.offered) return;
    this.offered = names;
    const boxes: [HTMLInputElement, readonly string[]][] = [];
    const report = (): void => this.hidden(new Set(boxes.flatMap(([box, members]) => (box.checked ? [] : members))));
    report();
    const fieldset = element("parts");
    for (const label of fieldset.querySelectorAll("label")) label.remove();
    fieldset.hidden = parts.size < 2;
    for (const [name, members] of parts) {
      const label = document.createElement("label");
      const box = Object.assign(document.createElement("input"), { type: "checkbox", checked: true });
      box.onchange = report;
      boxes.push([box, members]);
      label.append(box, name);
      fieldset.append(label);
    }
  }
}

/** The part of the body that a tracked point belongs to. */
export function partOf(point: string): string {
  for (const [pattern, label] of PARTS) {
    const match = pattern.exec(point);
    if (match) return label.replace("$1", match[1] ?? "").replace(/^./, (first) => first.toUpperCase());
  }
  return "Torso";
}
