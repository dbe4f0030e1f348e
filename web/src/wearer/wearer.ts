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

/** Return a person of a known height. Throws an Error of one line if the height is impossible. */
export function personOf(height: number | null): Person {
  if (height === null) return NOBODY;
  if (!isWithin(height, HEIGHTS)) {
    throw new Error(`A height of ${height} m is not a person's; give ${HEIGHTS.least} to ${HEIGHTS.most} m.`);
  }
  return { height };
}

/** Return the person for the engine. A known height takes precedence over the measured head. */
export function personFrom(height: number | null, measured: Measurement | null): Person {
  const { head, reach } = measured ?? { head: null, reach: null };
  const lengths =
    reach === null ? [] : [{ start: "left_wrist", end: "right_wrist", value: reach, deviation: DEVIATION }];
  if (height !== null) return { ...personOf(height), lengths };
  return head === null ? NOBODY : { head, lengths };
}

/** Return a stored measurement; null if it is invalid or not a person's. */
export function measurementFrom(value: unknown): Measurement | null {
  if (typeof value !== "object" || value === null) return null;
  const { head, reach } = value as Record<string, unknown>;
  return isWithin(head, HEADS) ? { head, reach: isWithin(reach, REACHES) ? reach : null } : null;
}
