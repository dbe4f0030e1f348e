/** Switches of the signal's sensors: the server does not look at those that are off. */

import { button, checkbox, element } from "./page";
import { hiddenPoints, sensorsOf, type Sensor } from "./sensors";

export class SensorPanel {
  private points: readonly string[] = [];
  private sensors: readonly Sensor[] = [];
  private readonly off = new Set<string>();

  /** `changed` gets the points that are hidden from now on. */
  constructor(private readonly changed: (hidden: string[]) => void) {
    button("head-only").onclick = () => this.keep((name) => name === "Head");
    button("all-sensors").onclick = () => this.keep(() => true);
    this.draw();
  }

  /** The points of the signal in hand, and those that the server does not look at. */
  offer(points: readonly string[], hidden: readonly string[]): void {
    if (points.join() !== this.points.join()) {
      this.points = points;
      this.sensors = sensorsOf(points);
      this.draw();
    }
    if ([...this.hidden].sort().join() !== [...hidden].sort().join()) this.changed(this.hidden);
  }

  get hidden(): string[] {
    return hiddenPoints(this.sensors, this.off);
  }

  private keep(isKept: (name: string) => boolean): void {
    for (const { name } of this.sensors) this.turn(name, isKept(name));
    this.draw();
    this.changed(this.hidden);
  }

  private turn(name: string, isOn: boolean): void {
    if (isOn) this.off.delete(name);
    else this.off.add(name);
  }

  private draw(): void {
    const boxes = this.sensors.map(({ name }) =>
      checkbox(name, !this.off.has(name), (isOn) => {
        this.turn(name, isOn);
        this.changed(this.hidden);
      }),
    );
    element("sensors").replaceChildren(...boxes);
    if (boxes.length === 0) element("sensors").textContent = "No signal yet.";
    button("head-only").disabled = !this.sensors.some(({ name }) => name === "Head");
    button("all-sensors").disabled = boxes.length === 0;
  }
}
