/** Keys of the whole page; those that a control in focus needs stay with it. */

export function onKeys(actions: Readonly<Record<string, () => void>>): void {
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target, event.key)) return;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });
}

function isTyping(target: EventTarget | null, key: string): boolean {
  if (target instanceof HTMLCanvasElement) return key.startsWith("Arrow"); // they turn the camera
  if (!(target instanceof HTMLElement) || target === document.body) return false;
  if (key === " " && target.matches("button, summary, label, a, input, select")) return true;
  return (
    target.matches("input:not([type=checkbox], [type=radio]), select, textarea") ||
    (key.startsWith("Arrow") && target.matches("input"))
  );
}
