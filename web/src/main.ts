import { App } from "./app";
import { element, find } from "./page";
import { View } from "./scene";

try {
  new App(new View(find("view", HTMLCanvasElement)));
} catch (error) {
  element("notice-text").textContent =
    `This page cannot draw in 3-D: ${String(error)}. Use a browser with WebGL 2, and switch its hardware acceleration on.`;
  element("notice").hidden = false;
}
