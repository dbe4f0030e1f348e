/** One line at the top of the page: what happened, and what to do about it. */

import { button, element } from "./page";

export class Notice {
  private again: (() => void) | null = null;

  constructor() {
    button("notice-close").onclick = () => this.clear();
    button("notice-action").onclick = () => {
      const { again } = this;
      this.clear();
      again?.();
    };
  }

  /** Good news, or a hint. */
  say(text: string): void {
    this.show(text, "news", null);
  }

  /** Show an error; `again` offers to connect again. */
  fault(text: string, again: (() => void) | null = null): void {
    this.show(text, "fault", again);
  }

  clear(): void {
    element("notice").hidden = true;
  }

  private show(text: string, kind: "news" | "fault", again: (() => void) | null): void {
    this.again = again;
    element("notice-text").textContent = text;
    element("notice").dataset["kind"] = kind;
    button("notice-action").hidden = again === null;
    element("notice").hidden = false;
  }
}

/** The one line of something that was thrown. */
export function reasonOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
