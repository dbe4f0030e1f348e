/** Files dropped on the page, or chosen by a button. */

import { element, input } from "../page";

export function onFiles(opened: (files: readonly File[]) => void): void {
  addEventListener("dragover", (event) => {
    event.preventDefault();
    document.body.classList.add("dragging");
  });
  addEventListener("dragleave", (event) => {
    if (event.relatedTarget === null) document.body.classList.remove("dragging");
  });
  addEventListener("drop", (event) => {
    event.preventDefault();
    document.body.classList.remove("dragging");
    opened([...(event.dataTransfer?.files ?? [])]);
  });
  const chooser = input("file");
  chooser.onchange = () => {
    opened([...(chooser.files ?? [])]);
    chooser.value = ""; // so that the same file may be chosen again
  };
  element("open-file").onclick = () => chooser.click();
}
