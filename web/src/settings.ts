/** The user's settings, saved in this browser. */

import { SENSOR_SETS, type SensorSet } from "./body/clip";
import { COLOURINGS } from "./view/colours";
import type { DisplaySettings } from "./view/bodies";
import { HEIGHTS, isWithin, lengthsFrom, measurementFrom, type Lengths, type Measurement } from "./wearer/wearer";

export const THEMES = ["auto", "light", "dark"] as const;
export type Theme = (typeof THEMES)[number];

export type MirrorSetting = "mirrored" | "mirroredWebcam";

export interface Settings extends DisplaySettings {
  readonly height: number | null; // m
  readonly measured: Measurement | null; // the wearer, by Measure me
  readonly lengths: Lengths; // of the wearer, as the user knows them
  readonly trackerNames: Readonly<Record<string, string>>; // by which the user calls trackers
  readonly sensors: SensorSet; // of the simulated headset
  readonly holdFeet: boolean;
  readonly theme: Theme;
  readonly mirrored: boolean; // left and right of the displayed body are swapped, as in a mirror
  readonly mirroredWebcam: boolean; // of a webcam's body and picture, where people expect a mirror
}

export const DEFAULT_SETTINGS: Settings = {
  height: null,
  measured: null,
  lengths: {},
  trackerNames: {},
  sensors: "hands",
  holdFeet: true,
  figure: "avatar",
  colouring: "plain",
  truth: false,
  signal: false, // off, because marks cover the face
  ghosts: true,
  theme: "auto",
  mirrored: false,
  mirroredWebcam: true,
};

const CHOICES: Readonly<Record<string, readonly unknown[]>> = {
  sensors: Object.keys(SENSOR_SETS),
  figure: ["avatar", "figure"],
  colouring: COLOURINGS,
  theme: THEMES,
  ...Object.fromEntries(
    ["holdFeet", "truth", "signal", "ghosts", "mirrored", "mirroredWebcam"].map((name) => [name, [true, false]]),
  ),
};
const KEY = "bodysense.page";

/** Return the valid settings in a text; invalid ones get their default. */
export function settingsFrom(text: string | null): Settings {
  const saved = parsed(text);
  const { height, measured } = saved;
  const names = Object.entries(Object(saved["trackerNames"]) as object).filter(([, name]) => typeof name === "string");
  const chosen = Object.entries(CHOICES).filter(([name, choices]) => choices.includes(saved[name]));
  return {
    ...DEFAULT_SETTINGS,
    ...Object.fromEntries(chosen.map(([name]) => [name, saved[name]])),
    height: isWithin(height, HEIGHTS) ? height : null,
    measured: measurementFrom(measured),
    lengths: lengthsFrom(saved["lengths"]),
    trackerNames: Object.fromEntries(names),
  };
}

/** Load the settings; the defaults if `storage` throws because the browser allows no storage. */
export function loadSettings(storage: () => Pick<Storage, "getItem">): Settings {
  try {
    return settingsFrom(storage().getItem(KEY));
  } catch {
    return DEFAULT_SETTINGS;
  }
}

/** Save the settings. Throws an Error of one line if the browser's storage is full or not allowed. */
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

function parsed(text: string | null): Record<string, unknown> {
  try {
    return Object(JSON.parse(text ?? "{}")) as Record<string, unknown>;
  } catch {
    return {};
  }
}
