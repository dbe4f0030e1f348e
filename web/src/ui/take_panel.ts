/** Takes: record, keep and save them. */

import type { Skeleton } from "../body/skeleton";
import type { History } from "../history";
import { KeptTake } from "../kept_take";
import { FILE_KINDS, saveMotion, type FileKind } from "../out/save";
import { button, element } from "../page";
import { Take } from "../take";

export interface TakeEvents {
  /** The skeleton of what is shown. */
  skeleton(): Skeleton;
  fault(error: unknown): void;
}

export class TakePanel {
  readonly take: Take;

  constructor(
    history: History,
    body: Skeleton,
    private readonly events: TakeEvents,
  ) {
    const kept = new KeptTake(events.fault);
    this.take = new Take(history, kept);
    button("record").onclick = () => this.toggle();
    for (const kind of FILE_KINDS)
      button(`save-${kind}`).onclick = () => void this.save(kind).catch((error: unknown) => events.fault(error));
    void kept.load(body.joints).then((frames) => {
      this.take.restore(frames);
      if (frames.length > 0) this.tell("Your last take has");
    });
  }

  toggle(): void {
    this.take.toggle();
    this.show();
  }

  /** End the recording, if there is one. */
  end(): void {
    this.take.end();
    this.show();
  }

  /** How things stand; a take that is as long as it may be has ended by itself. */
  show(): void {
    const { isRecording } = this.take;
    const text = isRecording ? "Stop" : "Record a take";
    if (button("record").textContent === text) return;
    button("record").textContent = text;
    button("record").setAttribute("aria-pressed", String(isRecording));
    if (!isRecording) this.tell("The last take has");
  }

  private tell(subject: string): void {
    const { seconds } = this.take;
    if (seconds > 0) element("take").textContent = `${subject} ${seconds.toFixed(1)} s; save it as`;
  }

  private async save(kind: FileKind): Promise<void> {
    await saveMotion(this.events.skeleton(), this.take.toSave(), kind);
  }
}
