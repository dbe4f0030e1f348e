/** How the body is shown: avatar or figure, its colours, truth and tracked points. */

import { choice, element, select, tick } from "../page";
import type { Settings } from "../settings";
import { legend } from "../view/colours";
import type { Wardrobe } from "../view/wardrobe";

export class LookPanel {
  private offered = "";

  constructor(
    settings: Settings,
    changed: (change: Partial<Settings>) => void,
    private readonly wear: (name: string) => void,
  ) {
    for (const radio of document.querySelectorAll<HTMLInputElement>("input[name=figure]")) {
      radio.onchange = () => changed({ figure: radio.value === "figure" ? "figure" : "avatar" });
    }
    choice("colouring", settings.colouring, (colouring) => changed({ colouring }));
    for (const name of ["truth", "signal", "ghosts"] as const)
      tick(name, settings[name], (isOn) => changed({ [name]: isOn }));
  }

  /** Show the choices that are available now, and the meaning of the colours. */
  show(settings: Settings, { names, wornName }: Pick<Wardrobe, "names" | "wornName">, hasTruth: boolean): void {
    this.offer(names, wornName);
    const isFigure = settings.figure === "figure" || wornName === null;
    for (const radio of document.querySelectorAll<HTMLInputElement>("input[name=figure]"))
      radio.checked = radio.value === settings.figure; // which the menu in VR changes, too
    element("avatar-row").hidden = isFigure || names.length < 2;
    element("colour-row").hidden = !isFigure;
    element("truth-row").hidden = !hasTruth;
    const { colouring } = settings;
    const shown = isFigure && (colouring !== "error" || hasTruth) ? legend(colouring) : null;
    element("legend").hidden = shown === null;
    if (!shown) return;
    element("legend-low").textContent = shown.low;
    element("legend-high").textContent = shown.high;
    element("legend-bar").style.background = shown.css;
  }

  private offer(names: readonly string[], worn: string | null): void {
    const offered = JSON.stringify([names, worn]);
    if (offered === this.offered || worn === null) return;
    this.offered = offered;
    select("avatar").replaceChildren(...names.map((name) => new Option(name)));
    choice("avatar", worn, this.wear);
  }
}
