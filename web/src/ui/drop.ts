/** Files dropped on the page, or chosen by a button. */

import { element, input } from "../page";

export function onFile(opened: (file: File) => void): void {
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
    const file = event.dataTransfer?.files[0];
    if (file) opened(file);
  });
  const chooser = input("file");
  chooser.onchange = () => {
    const file = chooser.files?.[0];
    if (file) opened(file);
    chooser.value = ""; // so that the same file may be chosen again
  };
  element("open-file").onclick = () => chooser.click();
}
