/** Plots of what is measured, over the last seconds before the moment that is shown. */

import { element } from "./page";
import type { History, Moment } from "./history";

interface Curve {
  readonly title: string;
  readonly unit: string;
  readonly digits: number;
  readonly atLeast: number; // of the vertical axis, so that nearly nothing looks like it
  readonly value: (moment: Moment) => number | null;
}

const SECONDS = 10;
const CURVES: readonly Curve[] = [
  {
    title: "Error against the truth",
    unit: "cm",
    digits: 1,
    atLeast: 5,
    value: ({ error }) => (error === null ? null : 100 * error),
  },
  { title: "Expected error", unit: "cm", digits: 1, atLeast: 5, value: ({ expected }) => 100 * expected },
  { title: "Time in the server", unit: "ms", digits: 2, atLeast: 2, value: ({ pose }) => pose.microseconds / 1000 },
  { title: "There and back", unit: "ms", digits: 1, atLeast: 10, value: ({ roundTrip }) => roundTrip },
];

export class Plots {
  private readonly rows = CURVES.map((curve) => new Row(curve));

  constructor() {
    element("plots").replaceChildren(...this.rows.map(({ figure }) => figure));
  }

  show(history: History, time: number): void {
    if (!element("plots").checkVisibility()) return;
    const from = history.indexAt(time - SECONDS);
    const shown = history.moments.slice(Math.max(from, 0), history.indexAt(time) + 1);
    for (const row of this.rows) row.draw(shown, time);
  }
}

class Row {
  readonly figure = document.createElement("figure");
  private readonly now = document.createElement("output");
  private readonly canvas = document.createElement("canvas");

  constructor(private readonly curve: Curve) {
    this.figure.className = "plot";
    const caption = document.createElement("figcaption");
    caption.append(curve.title, this.now);
    this.canvas.setAttribute("aria-hidden", "true"); // the caption says the value
    this.figure.append(caption, this.canvas);
  }

  draw(moments: readonly Moment[], time: number): void {
    const { value, unit, digits, atLeast } = this.curve;
    const points = moments.map((moment) => [moment.time, value(moment)] as const);
    const known = points.filter((point): point is readonly [number, number] => point[1] !== null);
    this.figure.hidden = known.length === 0;
    const newest = known.at(-1);
    if (!newest) return;
    const top = Math.max(atLeast, ...known.map(([, y]) => 1.5 * y));
    this.now.textContent = `${newest[1].toFixed(digits)} ${unit}`;
    this.trace(known, time, top, `${top.toFixed(digits)} ${unit}`);
  }

  private trace(points: readonly (readonly [number, number])[], time: number, top: number, label: string): void {
    const ratio = devicePixelRatio;
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    this.canvas.width = width * ratio;
    this.canvas.height = height * ratio;
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const style = getComputedStyle(this.canvas);
    context.scale(ratio, ratio);
    context.strokeStyle = context.fillStyle = style.getPropertyValue("color");
    context.globalAlpha = 0.25;
    context.strokeRect(0.5, 0.5, width - 1, height - 1);
    context.globalAlpha = 0.7;
    context.font = `11px ${style.fontFamily}`;
    context.fillText(label, 4, 12);
    context.globalAlpha = 1;
    context.lineWidth = 1.5;
    context.beginPath();
    for (const [x, y] of points) {
      context.lineTo(width * (1 - (time - x) / SECONDS), height - 2 - (height - 4) * (y / top));
    }
    context.stroke();
  }
}
