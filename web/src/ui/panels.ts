/** Panels over the stage: a button of the header opens each, one at a time; Escape closes it. */

import { button, element } from "../page";

/** `names`: ids of the buttons; each controls the element that its aria-controls names. */
export function bindPanels(names: readonly string[]): void {
  const panelOf = (name: string): HTMLElement => element(button(name).getAttribute("aria-controls") ?? name);
  const show = (name: string | null): void => {
    for (const other of names) {
      panelOf(other).hidden = other !== name;
      button(other).setAttribute("aria-expanded", String(other === name));
    }
  };
  for (const name of names)
    button(name).onclick = () => {
      if (!panelOf(name).hidden) return show(null);
      show(name);
      panelOf(name).scrollIntoView({ block: "nearest" }); // on a phone it is below the stage
      panelOf(name).focus({ preventScroll: true });
    };
  addEventListener("keydown", ({ key }) => {
    const open = names.find((name) => !panelOf(name).hidden);
    if (key !== "Escape" || open === undefined) return;
    show(null);
    button(open).focus();
  });
}
