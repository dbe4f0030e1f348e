/** The user's settings, saved in this browser. */

import { SENSOR_SETS, type SensorSet } from "./body/clip";
import { COLOURINGS } from "./view/colours";
import type { Shown } from "./view/bodies";
import { HEIGHTS, isWithin, measurementFrom, type Measurement } from "./wearer";

export const THEMES = ["auto", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

export interface Settings extends Shown {
  readonly height: number | null; // m
  readonly measured: Measurement | null; // the wearer, by Measure me
  readonly sensors: SensorSet; // of the simulated headset
  readonly holdFeet: boolean;
  readonly theme: Theme;
}

export const DEFAULT_SETTINGS: Settings = {
  height: null,
  measured: null,
  sensors: "hands",
  holdFeet: true,
  figure: "avatar",
  colouring: "plain",
  truth: false,
  signal: false, // marks on a face are for who asks what is tracked
  ghosts: true,
  theme: "auto",
};

const KEY = "bodysense.page";

/** Return the valid settings in a text; invalid ones get their default. */
export function settingsFrom(text: string | null): Settings {
  const saved = record(parsed(text));
  const fallback = DEFAULT_SETTINGS;
  const { height } = saved;
  return {
    height: isWithin(height, HEIGHTS) ? height : fallback.height,
    measured: measurementFrom(saved["measured"]),
    sensors: oneOf(Object.keys(SENSOR_SETS) as SensorSet[], saved["sensors"]) ?? fallback.sensors,
    holdFeet: flag(saved["holdFeet"], fallback.holdFeet),
    figure: oneOf(["avatar", "figure"] as const, saved["figure"]) ?? fallback.figure,
    colouring: oneOf(COLOURINGS, saved["colouring"]) ?? fallback.colouring,
    truth: flag(saved["truth"], fallback.truth),
    signal: flag(saved["signal"], fallback.signal),
    ghosts: flag(saved["ghosts"], fallback.ghosts),
    theme: oneOf(THEMES, saved["theme"]) ?? fallback.theme,
  };
}

/** `storage` throws where a person lets no page keep anything. */
export function loadSettings(storage: () => Pick<Storage, "getItem">): Settings {
  try {
    return settingsFrom(storage().getItem(KEY));
  } catch {
    return DEFAULT_SETTINGS;
  }
}

/** Throws an Error of one line where the browser's storage is full or not allowed. */
export function saveSettings(storage: () => Pick<Storage, "setItem">, settings: Settings): void {
  try {
    storage().setItem(KEY, JSON.stringify(settings));
  } catch (error) {
    throw new Error(`${whyNotStored(error)}: your settings count until you leave the page, and are not kept.`);
  }
}

/** Say why something could not be stored: it is not allowed, or there is no room. */
export function whyNotStored(error: unknown): string {
  const isRefused = error instanceof DOMException && error.name === "SecurityError";
  return isRefused ? "This browser lets the page store nothing" : "This browser's storage is full";
}

function parsed(text: string | null): unknown {
  try {
    return JSON.parse(text ?? "{}") as unknown;
  } catch {
    return {};
  }
}

function record(value: unknown): Record<string, unknown> {
  return typeof value === "object" && value !== null ? (value as Record<string, unknown>) : {};
}

function flag(value: unknown, fallback: boolean): boolean {
  return typeof value === "boolean" ? value : fallback;
}

function oneOf<T extends string>(choices: readonly T[], value: unknown): T | undefined {
  return choices.find((choice) => choice === value);
}
