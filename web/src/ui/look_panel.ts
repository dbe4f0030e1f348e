/** How the body is shown: avatar or figure, its colours, truth and tracked points. */

import { button, choices, element, input } from "../page";
import type { Settings } from "../settings";
import { COLOURINGS, legend, type Colouring } from "../view/colours";

const NAMES: Readonly<Record<Colouring, string>> = {
  plain: "Plain",
  confidence: "How sure",
  hidden: "Tracked or not",
  error: "Error against the truth",
};

export interface LookEvents {
  changed(change: Partial<Settings>): void;
  ownAvatar(): void;
}

export class LookPanel {
  private colouring: Colouring;

  constructor(settings: Settings, events: LookEvents) {
    this.colouring = settings.colouring;
    for (const radio of document.querySelectorAll<HTMLInputElement>("input[name=figure]")) {
      radio.checked = radio.value === settings.figure;
      radio.onchange = () => events.changed({ figure: radio.value === "figure" ? "figure" : "avatar" });
    }
    const rows = COLOURINGS.map((name) => [name, NAMES[name]] as const);
    choices("colouring", rows, settings.colouring, (colouring) => {
      this.colouring = colouring;
      events.changed({ colouring });
    });
    for (const name of ["truth", "signal"] as const) {
      const box = input(name);
      box.checked = settings[name];
      box.onchange = () => events.changed({ [name]: box.checked });
    }
    button("own-avatar").onclick = () => events.ownAvatar();
  }

  /** What there is to be chosen from now, and what the colours mean. */
  show(settings: Settings, hasAvatar: boolean, hasTruth: boolean): void {
    const isFigure = settings.figure === "figure" || !hasAvatar;
    element("colour-row").hidden = !isFigure;
    element("truth-row").hidden = !hasTruth;
    const shown = isFigure && (this.colouring !== "error" || hasTruth) ? legend(this.colouring) : null;
    element("legend").hidden = shown === null;
    if (!shown) return;
    element("legend-low").textContent = shown.low;
    element("legend-high").textContent = shown.high;
    element("legend-bar").style.background = shown.css;
  }
}
