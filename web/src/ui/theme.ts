/** Light or dark: as the person chose, or as their system is. */

import { THEMES, type Theme } from "../settings";
import type { Look } from "../view/scene";

/** Paint by the theme, now and when the system's theme changes. Returns a function that paints again. */
export function themed(theme: () => Theme, paint: (look: Look) => void): () => void {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const repaint = (): void => {
    const chosen = theme();
    const look = chosen === "auto" ? (dark.matches ? "dark" : "light") : chosen;
    document.documentElement.dataset["look"] = look;
    paint(look);
  };
  dark.addEventListener("change", repaint);
  repaint();
  return repaint;
}

export function nextTheme(theme: Theme): Theme {
  return THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
}
