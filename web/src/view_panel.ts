/** What is shown and how: layers, colours, theme, legend. */

import { legend } from "./colours";
import { choices, element, input } from "./page";
import type { Settings } from "./settings";

const LAYERS = ["result", "truth", "signal"] as const;

export class ViewPanel {
  private readonly dark = matchMedia("(prefers-color-scheme: dark)");

  constructor(
    private settings: Settings,
    private readonly changed: (change: Partial<Settings>) => void,
    private readonly paint: (theme: "light" | "dark") => void,
  ) {
    for (const layer of LAYERS) {
      const box = input(`show-${layer}`);
      box.checked = settings.show[layer];
      box.onchange = () => this.change({ show: { ...this.settings.show, [layer]: box.checked } });
    }
    choices(
      "colouring",
      [
        ["confidence", "Confidence"],
        ["hidden", "Seen or hidden"],
        ["error", "Error against the truth"],
        ["plain", "Plain"],
      ],
      settings.colouring,
      (colouring) => this.change({ colouring }),
    );
    choices(
      "theme",
      [
        ["auto", "Theme: auto"],
        ["light", "Light"],
        ["dark", "Dark"],
      ],
      settings.theme,
      (theme) => this.change({ theme }),
    );
    this.dark.onchange = () => this.show();
    this.show();
  }

  private change(change: Partial<Settings>): void {
    this.settings = { ...this.settings, ...change };
    this.changed(change);
    this.show();
  }

  private show(): void {
    const { theme, colouring } = this.settings;
    document.documentElement.dataset["theme"] = theme;
    this.paint(theme === "auto" ? (this.dark.matches ? "dark" : "light") : theme);
    const key = legend(colouring);
    element("legend").hidden = key === null;
    if (!key) return;
    element("legend-low").textContent = key.low;
    element("legend-high").textContent = key.high;
    element("legend-bar").style.background = key.css;
  }
}
