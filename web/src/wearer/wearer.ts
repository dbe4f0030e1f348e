/** The wearer's measurements, kept from source to source and from visit to visit. */

import type { Person as Known } from "@bodysense/core";

export interface Person extends Known {
  readonly head?: number; // m: height of the standing wearer's head joint; determines an unknown height
}

/** The result of measuring. */
export interface Measurement {
  readonly head: number; // m: height of the head joint
  readonly reach: number | null; // m, from wrist to wrist
}

export const NOBODY: Person = {};
export const HEIGHTS = { least: 1.0, most: 2.3 } as const; // m
const HEADS = { least: 0.8, most: 2.2 } as const; // m
export const REACHES = { least: 0.9, most: 2.0 } as const; // m
export const DEVIATION = 0.02; // m, standard deviation of measured lengths

export function isWithin(value: unknown, { least, most }: { least: number; most: number }): value is number {
  return typeof value === "number" && value >= least && value <= most;
}

/** Lengths that a user may know: their names, the points between which they are, and their range in m. */
export const LENGTHS = {
  reach: { text: "Arms, wrist to wrist", pairs: [["left_wrist", "right_wrist"]], ...REACHES },
  shoulders: { text: "Shoulders", pairs: [["left_shoulder", "right_shoulder"]], least: 0.2, most: 0.6 },
  upperArm: { text: "Shoulder to elbow", pairs: bothSides("shoulder", "elbow"), least: 0.15, most: 0.5 },
  forearm: { text: "Elbow to wrist", pairs: bothSides("elbow", "wrist"), least: 0.15, most: 0.45 },
  thigh: { text: "Hip to knee", pairs: bothSides("hip", "knee"), least: 0.25, most: 0.65 },
  shin: { text: "Knee to ankle", pairs: bothSides("knee", "ankle"), least: 0.25, most: 0.65 },
} as const;
export type LengthName = keyof typeof LENGTHS;
export type Lengths = Readonly<Partial<Record<LengthName, number>>>; // m
export const LENGTH_NAMES = Object.keys(LENGTHS) as LengthName[];

function bothSides(start: string, end: string): readonly (readonly [string, string])[] {
  return ["left", "right"].map((side) => [`${side}_${start}`, `${side}_${end}`]);
}

/** Return the distances between points that lengths determine. Throws an Error of one line if one is impossible. */
export function distancesOf(lengths: Lengths): { start: string; end: string; value: number }[] {
  return LENGTH_NAMES.flatMap((name) => {
    const [{ text, pairs, least, most }, value] = [LENGTHS[name], lengths[name]];
    if (value === undefined) return [];
    if (!isWithin(value, { least, most }))
      throw new Error(`${text}: ${value} m is not a person's; give ${least} to ${most} m.`);
    return pairs.map(([start, end]) => ({ start, end, value }));
  });
}

/** Return the valid lengths among stored ones. */
export function lengthsFrom(value: unknown): Lengths {
  const saved = Object(value) as Record<string, unknown>;
  return Object.fromEntries(
    LENGTH_NAMES.flatMap((name) => (isWithin(saved[name], LENGTHS[name]) ? [[name, saved[name]]] : [])),
  );
}

/** Return a person of a known height. Throws an Error of one line if the height is impossible. */
export function personOf(height: number | null): Person {
  if (height === null) return NOBODY;
  if (!isWithin(height, HEIGHTS)) {
    throw new Error(`A height of ${height} m is not a person's; give ${HEIGHTS.least} to ${HEIGHTS.most} m.`);
  }
  return { height };
}

/** Return the person for the engine. A known height or reach takes precedence over the measured one. */
export function personFrom(height: number | null, measured: Measurement | null, known: Lengths = {}): Person {
  const { head, reach } = measured ?? { head: null, reach: null };
  const distances = distancesOf({ ...(reach === null ? {} : { reach }), ...known });
  const lengths = distances.map((distance) => ({ ...distance, deviation: DEVIATION }));
  if (height !== null) return { ...personOf(height), lengths };
  if (head !== null) return { head, lengths };
  return lengths.length === 0 ? NOBODY : { lengths };
}

/** Return a stored measurement; null if it is invalid or not a person's. */
export function measurementFrom(value: unknown): Measurement | null {
  if (typeof value !== "object" || value === null) return null;
  const { head, reach } = value as Record<string, unknown>;
  return isWithin(head, HEADS) ? { head, reach: isWithin(reach, REACHES) ? reach : null } : null;
}
