/** Finding the page's elements, by id and kind. */

export function find<T extends HTMLElement>(id: string, kind: new () => T): T {
  const element = document.getElementById(id);
  if (!(element instanceof kind)) throw new Error(`index.html has no ${kind.name} with the id ${id}`);
  return element;
}

export const button = (id: string): HTMLButtonElement => find(id, HTMLButtonElement);
export const input = (id: string): HTMLInputElement => find(id, HTMLInputElement);
export const select = (id: string): HTMLSelectElement => find(id, HTMLSelectElement);
export const element = (id: string): HTMLElement => find(id, HTMLElement);

/** Fill a select with choices (value, text) and call back with what is chosen. */
export function choices<T extends string>(
  id: string,
  options: readonly (readonly [T, string])[],
  value: T,
  chosen: (value: T) => void,
): void {
  const box = select(id);
  box.replaceChildren(...options.map(([key, text]) => new Option(text, key, key === value, key === value)));
  box.onchange = () => {
    const option = options.find(([key]) => key === box.value);
    if (option) chosen(option[0]);
  };
}

/** A labelled checkbox. */
export function checkbox(text: string, checked: boolean, changed: (checked: boolean) => void): HTMLLabelElement {
  const label = document.createElement("label");
  const box = document.createElement("input");
  box.type = "checkbox";
  box.checked = checked;
  box.onchange = () => changed(box.checked);
  label.append(box, text);
  return label;
}
