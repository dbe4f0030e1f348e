/** One line at the top of the page: what went wrong and what to do about it. */

import { button, element } from "./page";

export class Notice {
  constructor(again: () => void) {
    button("notice-close").onclick = () => this.clear();
    button("notice-action").onclick = () => {
      this.clear();
      again();
    };
  }

  /** `canRetry` offers to connect again. */
  say(text: string, canRetry = false): void {
    element("notice-text").textContent = text;
    button("notice-action").hidden = !canRetry;
    element("notice").hidden = false;
  }

  clear(): void {
    element("notice").hidden = true;
  }
}

/** The one line of something that was thrown. */
export function reasonOf(error: unknown): string {
  return error instanceof Error ? error.message : String(error);
}
