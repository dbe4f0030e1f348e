import { App } from "./app";
import { Engine } from "./engine/engine";
import { firstFiles } from "./first";
import { reasonOf } from "./notice";
import { element, find } from "./page";
import { View } from "./view/scene";

function fault(text: string): void {
  element("notice-text").textContent = text;
  element("notice").dataset["kind"] = "fault";
  element("notice").hidden = false;
}

function viewOf(canvas: HTMLCanvasElement): View | null {
  try {
    const isClear = new URLSearchParams(location.search).get("background") === "transparent";
    if (isClear) document.documentElement.dataset["background"] = "transparent";
    return new View(canvas, element("transport"), element("intro"), isClear);
  } catch (error) {
    fault(
      `This page cannot draw in 3-D: ${String(error)}. Use a browser with WebGL 2, and switch its hardware acceleration on.`,
    );
    return null;
  }
}

const canvas = find("view", HTMLCanvasElement);
canvas.addEventListener("webglcontextlost", () =>
  fault("The graphics card stopped drawing; takes are kept. Load the page again if it does not come back."),
);
canvas.addEventListener("webglcontextrestored", () => (element("notice").hidden = true));
const base = document.baseURI;
const files = firstFiles(base); // on their way while the 3-D view is made
const view = viewOf(canvas);
let pressed: HTMLButtonElement | null = null; // before there is an app that hears it
const remember = ({ target }: Event): void => {
  pressed = target instanceof Element ? target.closest("button") : null;
};
addEventListener("click", remember);
if (view)
  files
    .then((first) => {
      new App(view, new Engine(base), first, base);
      removeEventListener("click", remember);
      pressed?.click();
    })
    .catch((error: unknown) => fault(reasonOf(error)));
