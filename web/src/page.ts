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

/** Show one choice of a select, and call back with the user's choice. */
export function choice<T extends string>(id: string, value: T, chosen: (value: T) => void): void {
  const box = select(id);
  box.value = value;
  box.onchange = () => chosen(box.value as T);
}

/** Show whether a checkbox is ticked, and call back with the user's choice. */
export function tick(id: string, isOn: boolean, chosen: (isOn: boolean) => void): void {
  const box = input(id);
  box.checked = isOn;
  box.onchange = () => chosen(box.checked);
}

/** A new element, with the name that is read aloud. */
export function made<K extends keyof HTMLElementTagNameMap>(kind: K, label: string, properties: object) {
  const element = Object.assign(document.createElement(kind), properties);
  element.setAttribute("aria-label", label);
  return element;
}
