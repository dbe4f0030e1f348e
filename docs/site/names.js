// Names and keyboard focus that Material leaves out; its own scripts add these parts after the page is loaded.
const name = () => {
  document.querySelector("[role=dialog]:not([aria-label])")?.setAttribute("aria-label", "Search");
  document.querySelectorAll(".md-code__nav").forEach((bar, k) => bar.setAttribute("aria-label", `Code ${k + 1}`));
  document.querySelectorAll(".md-typeset__scrollwrap").forEach((table) => table.setAttribute("tabindex", "0"));
};
addEventListener("load", () => {
  name();
  new MutationObserver(name).observe(document.body, { childList: true, subtree: true });
});
