import { App } from "./app";
import { EmbeddedPage } from "./embed/embedded";
import { Embedder, originOf } from "./embed/embedder";
import { Engine } from "./engine/engine";
import { firstFiles } from "./first";
import { Notice, reasonOf } from "./notice";
import { element, find } from "./page";
import { View } from "./view/scene";

const address = new URLSearchParams(location.search);
const notice = new Notice();
let embedder: Embedder | null = null;

function fault(text: string): void {
  notice.fault(text);
  embedder?.send({ bodysense: "error", reason: text });
}

/** Return the page around this one; null if this page is not in a frame. */
function embedderOf(): Embedder | null {
  const named = address.get("embed");
  if (named === null || parent === window) return null;
  document.documentElement.dataset["embed"] = "";
  return new Embedder(originOf(named, document.referrer));
}

function viewOf(canvas: HTMLCanvasElement): View | null {
  try {
    const isClear = address.get("background") === "transparent";
    if (isClear) document.documentElement.dataset["background"] = "transparent";
    return new View(canvas, element("transport"), element("intro"), [element("panel"), element("take-panel")], isClear);
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
canvas.addEventListener("webglcontextrestored", () => notice.clear());
const base = document.baseURI;
const files = firstFiles(base); // on their way while the 3-D view is made
let pressed: HTMLButtonElement | null = null; // before there is an app that hears it
const remember = ({ target }: Event): void => {
  pressed = target instanceof Element ? target.closest("button") : null;
};
addEventListener("click", remember);

async function open(): Promise<void> {
  embedder = embedderOf();
  const view = viewOf(canvas);
  if (!view) return;
  const first = await files;
  if (embedder) new EmbeddedPage(view, new Engine(base), first, base, notice, embedder);
  else new App(view, new Engine(base), first, base, notice);
  removeEventListener("click", remember);
  pressed?.click();
}
open().catch((error: unknown) => fault(reasonOf(error)));
