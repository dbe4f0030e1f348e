/** Light or dark: as the person chose, or as their system is. */

import { THEMES, type Theme } from "../settings";
import type { Look } from "../view/scene";

const dark = matchMedia("(prefers-color-scheme: dark)");

export function lookOf(theme: Theme): Look {
  if (theme !== "auto") return theme;
  return dark.matches ? "dark" : "light";
}

export function applyTheme(theme: Theme, paint: (look: Look) => void): void {
  const look = lookOf(theme);
  document.documentElement.dataset["look"] = look;
  paint(look);
}

export function onSystemChange(changed: () => void): void {
  dark.addEventListener("change", changed);
}

export function nextTheme(theme: Theme): Theme {
  return THEMES[(THEMES.indexOf(theme) + 1) % THEMES.length];
}
