/** Keyboard shortcuts of the page, active unless a control has the focus. */

// Controls that use keys themselves: Space presses a button and ticks a box, arrows move a slider.
const TAKES_KEYS = "input, select, textarea, button, summary, a[href], [contenteditable]";

export function onKeys(keys: Readonly<Record<string, () => void>>): void {
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.target instanceof Element && event.target.matches(TAKES_KEYS)) return;
    const pressed = keys[event.key] ?? keys[event.key.toLowerCase()];
    if (!pressed) return;
    event.preventDefault();
    pressed();
  });
}
