/** How the body is shown: avatar or figure, its colours, truth and tracked points. */

import { choice, element, input, select, tick } from "../page";
import type { MirrorSetting, Settings } from "../settings";
import { legend } from "../view/colours";
import type { Wardrobe } from "../view/wardrobe";

export class LookPanel {
  private offered = "";
  private mirror: MirrorSetting = "mirrored";

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
    tick("mirrored", settings.mirrored, (isOn) => changed({ [this.mirror]: isOn }));
  }

  /** Show the choices that are available now, and the meaning of the colours; `mirror`: the setting of the source. */
  show(
    settings: Settings,
    mirror: MirrorSetting,
    { names, currentName }: Pick<Wardrobe, "names" | "currentName">,
    hasTruth: boolean,
  ): void {
    this.offer(names, currentName);
    const isFigure = settings.figure === "figure" || currentName === null;
    for (const radio of document.querySelectorAll<HTMLInputElement>("input[name=figure]"))
      radio.checked = radio.value === settings.figure; // the menu in VR changes it, too
    this.mirror = mirror;
    input("mirrored").checked = settings[mirror]; // so does the button at the webcam's picture
    element("avatar-row").hidden = isFigure || names.length < 2;
    element("colour-row").hidden = !isFigure;
    element("truth-row").hidden = !hasTruth;
    const { colouring } = settings;
    const bar = isFigure && (colouring !== "error" || hasTruth) ? legend(colouring) : null;
    element("legend").hidden = bar === null;
    if (!bar) return;
    element("legend-low").textContent = bar.low;
    element("legend-high").textContent = bar.high;
    element("legend-bar").style.background = bar.css;
  }

  private offer(names: readonly string[], current: string | null): void {
    const offered = JSON.stringify([names, current]);
    if (offered === this.offered || current === null) return;
    this.offered = offered;
    select("avatar").replaceChildren(...names.map((name) => new Option(name)));
    choice("avatar", current, this.wear);
  }
}
