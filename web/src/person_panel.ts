/** Setting a person up: height, posture, mirror, the floor, what is driven, smoothing. */

import { button, checkbox, element, input } from "./page";
import { REGIONS, type Region } from "./protocol";
import { DEEPEST_FLOOR, HEIGHTS, SLOWEST, type PersonSettings, type Settings } from "./settings";

const NAMES: Readonly<Record<Region, string>> = {
  torso: "Torso",
  head: "Head",
  arms: "Arms",
  fingers: "Fingers",
  legs: "Legs",
};

export interface PersonEvents {
  changed(change: Partial<PersonSettings>): void;
  calibrate(): void;
  recentre(): void;
}

export class PersonPanel {
  constructor(
    private settings: Settings,
    private readonly events: PersonEvents,
  ) {
    const [height, smoothing, mirror] = [input("height"), input("smoothing"), input("mirror")];
    height.min = String(HEIGHTS.least);
    height.max = String(HEIGHTS.most);
    height.value = settings.height === null ? "" : String(settings.height);
    height.onchange = () => {
      if (height.reportValidity()) this.change({ height: height.value === "" ? null : Number(height.value) });
    };
    smoothing.max = String(SLOWEST);
    smoothing.value = String(settings.smoothing);
    smoothing.onchange = () => this.change({ smoothing: Number(smoothing.value) });
    smoothing.oninput = () => this.saySmoothing(Number(smoothing.value));
    this.saySmoothing(settings.smoothing);
    mirror.checked = settings.mirror;
    mirror.onchange = () => this.change({ mirror: mirror.checked });
    const [floor, holdFeet] = [input("floor"), input("hold-feet")];
    floor.min = String(-DEEPEST_FLOOR);
    floor.max = String(DEEPEST_FLOOR);
    floor.value = String(settings.floor);
    floor.onchange = () => {
      if (floor.reportValidity()) this.change({ floor: Number(floor.value) });
    };
    holdFeet.checked = settings.hold_feet;
    holdFeet.onchange = () => this.change({ hold_feet: holdFeet.checked });
    for (const radio of document.querySelectorAll<HTMLInputElement>("input[name=posture]")) {
      radio.checked = radio.value === settings.posture;
      radio.onchange = () => this.change({ posture: radio.value === "seated" ? "seated" : "standing" });
    }
    element("regions").append(...REGIONS.map((region) => this.regionBox(region)));
    button("calibrate").onclick = () => events.calibrate();
    button("recentre").onclick = () => events.recentre();
  }

  showHeight(height: number): void {
    this.settings = { ...this.settings, height };
    input("height").value = height.toFixed(2);
  }

  private regionBox(region: Region): HTMLLabelElement {
    return checkbox(NAMES[region], this.settings.regions.includes(region), (isDriven) => {
      const kept = REGIONS.filter((name) => (name === region ? isDriven : this.settings.regions.includes(name)));
      this.change({ regions: kept });
    });
  }

  private change(change: Partial<PersonSettings>): void {
    this.settings = { ...this.settings, ...change };
    this.events.changed(change);
  }

  private saySmoothing(halfLife: number): void {
    const milliseconds = Math.round(1000 * halfLife);
    const text =
      milliseconds === 0
        ? "none: the least latency"
        : `half-life ${milliseconds} ms: steadier, and about as much later`;
    element("smoothing-value").textContent = text;
    input("smoothing").setAttribute("aria-valuetext", text);
  }
}
