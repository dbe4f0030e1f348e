/** Sensors that one can switch off: the points of a signal, grouped by the part of the body that they belong to. */

export interface Sensor {
  readonly name: string; // for the person
  readonly points: readonly string[];
}

const PARTS: readonly (readonly [RegExp, string])[] = [
  [/^(headset|head|neck|head_top|nose)$/, "Head"],
  [/^(left|right)_(hip|knee|ankle|foot|toe)$/, "$1 leg"],
  [/^(left|right)_(collar|shoulder|elbow)$/, "$1 arm"],
  [/^(left|right)[_:]/, "$1 hand"],
];

export function sensorsOf(points: readonly string[]): Sensor[] {
  const groups = new Map<string, string[]>();
  for (const point of points) {
    const name = partOf(point);
    groups.set(name, [...(groups.get(name) ?? []), point]);
  }
  return [...groups].map(([name, members]) => ({ name, points: members }));
}

/** The points of the sensors that are switched off. */
export function hiddenPoints(sensors: readonly Sensor[], off: ReadonlySet<string>): string[] {
  return sensors.filter(({ name }) => off.has(name)).flatMap(({ points }) => points);
}

function partOf(point: string): string {
  for (const [pattern, label] of PARTS) {
    const match = pattern.exec(point);
    if (match) return capitalised(label.replace("$1", match[1]));
  }
  return "Torso";
}

function capitalised(text: string): string {
  return text.charAt(0).toUpperCase() + text.slice(1);
}
