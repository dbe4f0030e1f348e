/** The wearer: height, measuring, sitting, the floor. */

import { distance } from "../body/math";
import { restPoint, stature, type Skeleton } from "../body/skeleton";
import type { Settings } from "../settings";
import { button, element, input, tick } from "../page";
import { LENGTH_NAMES, LENGTHS, type LengthName } from "../wearer/wearer";

const HINT = element("calibrate-hint").textContent;

export interface YouEvents {
  height(metres: number | null): void;
  length(name: LengthName, metres: number | undefined): void;
  measure(): void;
  forget(): void;
  recentre(): void;
  sit(isSeated: boolean): void;
  holdFeet(isHeld: boolean): void;
}

export class YouPanel {
  constructor(settings: Settings, events: YouEvents) {
    const field = input("height");
    element("length-list").replaceChildren(...LENGTH_NAMES.map((name) => rowOf(name, events)));
    this.show(settings);
    field.onchange = () => events.height(numberIn(field) ?? null);
    button("calibrate").onclick = () => events.measure();
    button("forget").onclick = () => events.forget();
    button("recentre").onclick = () => events.recentre();
    tick("seated", false, (isSeated) => events.sit(isSeated));
    tick("hold-feet", settings.holdFeet, (isHeld) => events.holdFeet(isHeld));
  }

  show({ height, measured, lengths }: Pick<Settings, "height" | "measured" | "lengths">): void {
    input("height").value = height === null ? "" : height.toFixed(2);
    const known = { ...(measured?.reach ? { reach: measured.reach } : {}), ...lengths };
    for (const name of LENGTH_NAMES) input(name).value = known[name]?.toFixed(2) ?? "";
    button("forget").hidden = measured === null && Object.keys(lengths).length === 0;
    const reach = measured?.reach ? `, arms ${measured.reach.toFixed(2)} m from wrist to wrist` : "";
    element("calibrate-hint").textContent = measured
      ? `You are measured: head ${measured.head.toFixed(2)} m high${reach}. Kept in this browser.`
      : HINT;
  }

  /** Show the lengths of the displayed body where the user knows none. */
  showBody(tree: Skeleton): void {
    input("height").placeholder = stature(tree).toFixed(2);
    for (const name of LENGTH_NAMES) {
      const [[start, end]] = LENGTHS[name].pairs;
      input(name).placeholder = distance(restPoint(tree, start), restPoint(tree, end)).toFixed(2);
    }
  }

  showSeated(isSeated: boolean): void {
    input("seated").checked = isSeated;
  }
}

function numberIn(field: HTMLInputElement): number | undefined {
  return field.value.trim() === "" ? undefined : Number(field.value);
}

/** A field for a length. */
function rowOf(name: LengthName, events: YouEvents): HTMLLabelElement {
  const field = Object.assign(document.createElement("input"), { id: name, type: "number", step: "0.01" });
  field.inputMode = "decimal";
  field.onchange = () => events.length(name, numberIn(field));
  const [row, text, unit] = [
    document.createElement("label"),
    ...["span", "span"].map((kind) => document.createElement(kind)),
  ];
  row.className = "row";
  unit.className = "unit";
  text.textContent = LENGTHS[name].text;
  unit.append(field, " m");
  row.append(text, unit);
  return row;
}
