/** The panel of sensors: simulated ones, parts of the body that can be switched off, and where trackers are worn. */

import type { SensorSet } from "../body/clip";
import { choice, element, made } from "../page";
import { nameOf, placeOf, PLACES, usualPlace, type Worn } from "../wearer/trackers";

export interface SensorEvents {
  set(set: SensorSet): void;
  hidden(points: ReadonlySet<string>): void;
  /** A tracker is worn on a joint; "": nowhere. */
  move(tracker: string, joint: string): void;
  /** The user calls a tracker by a name; "": by its own. */
  name(tracker: string, name: string): void;
}

const PARTS: readonly (readonly [RegExp, string])[] = [
  [/^(headset|head|neck|head_top|nose)$/, "Head"],
  [/^(left|right)_(hip|knee|ankle|foot|toe)/, "$1 leg"],
  [/^(left|right)_(collar|shoulder|elbow)/, "$1 arm"],
  [/^(left|right)[_:]/, "$1 hand"],
];

export class SensorPanel {
  private offered = "";
  private listed = "";

  constructor(
    set: SensorSet,
    private readonly events: SensorEvents,
  ) {
    choice("set", set, events.set);
  }

  /** List the strapped trackers among tracked points, where they are worn and what they are called. */
  list(points: readonly string[], worn: Worn, names: Readonly<Record<string, string>>): void {
    const trackers = points.filter((point) => usualPlace(point) !== null);
    const state = JSON.stringify([trackers, worn, names]);
    if (state === this.listed) return;
    this.listed = state;
    const focused = document.activeElement?.id ?? "";
    element("trackers").hidden = trackers.length === 0;
    element("tracker-list").replaceChildren(
      ...trackers.map((tracker) => this.row(tracker, placeOf(tracker, worn), names[tracker] ?? nameOf(tracker))),
    );
    document.getElementById(focused)?.focus(); // a redrawn list keeps the focus
  }

  private row(tracker: string, joint: string, name: string): HTMLLIElement {
    const { events } = this;
    const field = made("input", `Name of ${nameOf(tracker)}`, { type: "text", value: name, id: `tracker-${tracker}` });
    field.onchange = () => events.name(tracker, field.value.trim());
    const place = made("select", `Where ${name} is worn`, { id: `worn-${tracker}` });
    place.append(new Option("Nowhere", ""), ...Object.entries(PLACES).map(([value, text]) => new Option(text, value)));
    place.value = joint;
    place.onchange = () => events.move(tracker, place.value);
    const forget = made("button", `Forget ${name}`, { textContent: "×", className: "quiet" });
    forget.onclick = () => {
      events.name(tracker, "");
      events.move(tracker, usualPlace(tracker) ?? "");
    };
    const item = document.createElement("li");
    item.append(field, place, forget);
    return item;
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
    const report = (): void =>
      this.events.hidden(new Set(boxes.flatMap(([box, members]) => (box.checked ? [] : members))));
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
