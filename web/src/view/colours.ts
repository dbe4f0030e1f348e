/** A body's colours: confidence, hidden parts, the error against the truth. */

import { Color } from "three";
import type { Moment } from "../takes/history";

export const COLOURINGS = ["plain", "confidence", "hidden", "error"] as const;
export type Colouring = (typeof COLOURINGS)[number];

const SCALE = ["#2f6fd0", "#2fa8b5", "#e8c547", "#e08e2b", "#d1495b"].map((hex) => new Color(hex)); // sure … unsure
const SEEN = new Color("#2f7ed8");
const HIDDEN = new Color("#e08e2b");
export const PLAIN = new Color("#9db4c8");
export const TRUTH_COLOUR = new Color("#4caf7d");
export const SIGNAL_COLOUR = new Color("#b35cd6");

const WORST = 0.15; // m: larger errors have the last colour

/** Blue over yellow to red: colours that also colour-blind eyes order by brightness. */
export function scale(metres: number, out: Color): Color {
  const place = Math.min(Math.max(metres / WORST, 0), 1) * (SCALE.length - 1);
  const below = Math.min(Math.floor(place), SCALE.length - 2);
  return out.lerpColors(SCALE[below], SCALE[below + 1], place - below);
}

/** The colour of a point of a body. */
export function pointColour(moment: Moment, point: number, colouring: Colouring, out: Color): Color {
  if (colouring === "confidence") return scale(moment.expected?.[point] ?? 0, out);
  if (colouring === "hidden") return out.lerpColors(SEEN, HIDDEN, moment.measured?.[point] ? 0 : 1);
  if (colouring === "error" && moment.truth) {
    const [a, b, at] = [moment.body.position, moment.truth.position, 3 * point];
    return scale(Math.hypot(a[at] - b[at], a[at + 1] - b[at + 1], a[at + 2] - b[at + 2]), out);
  }
  return out.copy(PLAIN);
}

/** The words at both ends of a scale, and its colours as a gradient of CSS; null for a colour without a meaning. */
export function legend(colouring: Colouring): Readonly<Record<"low" | "high" | "css", string>> | null {
  const centimetres = `${WORST * 100} cm or more`;
  const css = gradient((share, out) => scale(share * WORST, out));
  if (colouring === "confidence") return { low: "sure (0 cm)", high: centimetres, css };
  if (colouring === "error") return { low: "0 cm off the truth", high: centimetres, css };
  if (colouring === "plain") return null;
  return { low: "seen", high: "hidden", css: gradient((share, out) => out.lerpColors(SEEN, HIDDEN, share)) };
}

function gradient(colour: (share: number, out: Color) => Color): string {
  const stops = Array.from({ length: 9 }, (_, k) => `#${colour(k / 8, new Color()).getHexString()}`);
  return `linear-gradient(to right, ${stops.join(", ")})`;
}
