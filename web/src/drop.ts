/** Files dropped on the page, or chosen by the button. */

import { element, input } from "./page";

export function onFile(opened: (file: File) => void): void {
  const stage = element("stage");
  addEventListener("dragover", (event) => {
    event.preventDefault();
    stage.classList.add("dragging");
  });
  addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) stage.classList.remove("dragging");
  });
  addEventListener("drop", (event) => {
    event.preventDefault();
    stage.classList.remove("dragging");
    const file = event.dataTransfer?.files[0];
    if (file) opened(file);
  });
  const chooser = input("avatar-file");
  chooser.onchange = () => {
    const file = chooser.files?.[0];
    if (file) opened(file);
    chooser.value = ""; // so that the same file may be chosen again
  };
}
