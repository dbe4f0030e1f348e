/** The takes next to the stage: record, name, look at, cut, save and delete them. */

import type { Skeleton } from "../body/skeleton";
import type { History } from "../takes/history";
import { KeptTakes } from "../takes/kept_takes";
import { FILE_KINDS, saveMotion, type FileKind } from "../out/save";
import { button, element, made } from "../page";
import { partOf, Takes, type Take } from "../takes/takes";

export interface TakeEvents {
  /** The skeleton of the displayed body. */
  skeleton(): Skeleton;
  /** Show a take on the stage; null: the displayed take was deleted. */
  show(take: Take | null): void;
  /** Where the timeline is, s since its beginning. */
  time(): number;
  fault(error: unknown): void;
}

const HINT = element("take").textContent;

export class TakePanel {
  readonly takes: Takes;
  private drawn = "";
  private displayed: number | null = null; // the take on the stage

  constructor(
    history: History,
    body: Skeleton,
    private readonly events: TakeEvents,
  ) {
    const kept = new KeptTakes(events.fault);
    this.takes = new Takes(history, kept);
    button("record").onclick = () => this.takes.toggle();
    for (const kind of FILE_KINDS)
      button(`save-${kind}`).onclick = () => void this.save(kind).catch((error: unknown) => events.fault(error));
    button("cut-before").onclick = () => this.cut(([, to]) => [Math.min(events.time(), to), to]);
    button("cut-after").onclick = () => this.cut(([from]) => [from, Math.max(events.time(), from)]);
    button("cut-nothing").onclick = () => this.cut(() => null);
    void kept.load(body.joints).then((takes) => this.takes.restore(takes));
  }

  /** End the recording, as another source begins. */
  leave(): void {
    this.takes.end();
    this.displayed = null;
  }

  /** Update the panel. A take of maximum length has ended by itself. */
  draw(): void {
    const { all, chosen, isRecording } = this.takes;
    const state = JSON.stringify([
      all.map(({ id, name, part }) => [id, name, part]),
      chosen?.id,
      isRecording,
      this.displayed,
    ]);
    if (state === this.drawn) return;
    this.drawn = state;
    button("record").textContent = isRecording ? "Stop" : "Record a take";
    button("record").setAttribute("aria-pressed", String(isRecording));
    element("take").textContent = chosen ? `${chosen.name}: ${lengthOf(chosen)} are saved as` : HINT;
    element("cuts").hidden = this.displayed === null || this.displayed !== chosen?.id;
    const focused = document.activeElement?.id ?? "";
    element("take-list").replaceChildren(...all.map((take) => this.row(take)));
    document.getElementById(focused)?.focus(); // a redrawn list keeps the focus
  }

  private row(take: Take): HTMLLIElement {
    const { id, name } = take;
    const length = lengthOf(take);
    const field = made("input", `Name of ${name}`, { type: "text", value: name, id: `name-${id}` });
    field.onchange = () => this.takes.describe(id, { name: field.value.trim() || name });
    const show = made("button", `Show ${name}, ${length}`, { textContent: length, id: `show-${id}` });
    show.setAttribute("aria-pressed", String(id === this.takes.chosen?.id));
    show.onclick = () => {
      this.takes.choose(id);
      this.events.show(take);
      this.displayed = id;
    };
    const remove = made("button", `Delete ${name}`, { textContent: "×", className: "quiet" });
    remove.onclick = () => {
      if (this.displayed === id) this.events.show(null);
      this.takes.remove(id);
    };
    const item = document.createElement("li");
    item.append(field, show, remove);
    return item;
  }

  private cut(part: (now: readonly [number, number]) => Take["part"]): void {
    const { chosen } = this.takes;
    if (chosen) this.takes.describe(chosen.id, { part: part(partOf(chosen)) });
  }

  private async save(kind: FileKind): Promise<void> {
    const { chosen } = this.takes;
    await saveMotion(this.events.skeleton(), this.takes.toSave(), kind, chosen?.name ?? "bodysense");
  }
}

function lengthOf(take: Take): string {
  const [from, to] = partOf(take);
  return `${(to - from).toFixed(1)} s`;
}
