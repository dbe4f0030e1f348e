/** What a person set up, saved in this browser; what the server has to know of it is SessionSettings. */

import { REGIONS, type Settings as SessionSettings } from "./protocol";

export const COLOURINGS = ["confidence", "hidden", "error", "plain"] as const;
export const THEMES = ["auto", "light", "dark"] as const;

export type Colouring = (typeof COLOURINGS)[number];
export type Theme = (typeof THEMES)[number];

/** What is saved of a session's settings; which sensors are switched off is not. */
export type PersonSettings = Omit<SessionSettings, "hidden">;

export interface Settings extends PersonSettings {
  readonly colouring: Colouring;
  readonly theme: Theme;
  readonly show: { readonly result: boolean; readonly truth: boolean; readonly signal: boolean };
}

export const HEIGHTS = { least: 1.0, most: 2.3 } as const; // m
export const SLOWEST = 0.5; // s, of smoothing
export const DEEPEST_FLOOR = 10; // m

export const DEFAULT_SETTINGS: Settings = {
  height: null,
  posture: "standing",
  mirror: false,
  regions: [...REGIONS],
  smoothing: 0,
  floor: 0,
  hold_feet: true,
  colouring: "confidence",
  theme: "auto",
  show: { result: true, truth: true, signal: true },
};

const KEY = "bodysense.settings";

/** What of a text is valid settings; the default stands for the rest. */
export function settingsFrom(text: string | null): Settings {
  const saved = record(parsed(text));
  const show = record(saved["show"]);
  const fallback = DEFAULT_SETTINGS;
  return {
    height: isHeight(saved["height"]) ? saved["height"] : fallback.height,
    posture: oneOf(["standing", "seated"] as const, saved["posture"]) ?? fallback.posture,
    mirror: flag(saved["mirror"], fallback.mirror),
    regions: REGIONS.filter((name) => listOf(saved["regions"])?.includes(name) ?? true),
    smoothing: isHalfLife(saved["smoothing"]) ? saved["smoothing"] : fallback.smoothing,
    floor: isFloor(saved["floor"]) ? saved["floor"] : fallback.floor,
    hold_feet: flag(saved["hold_feet"], fallback.hold_feet),
    colouring: oneOf(COLOURINGS, saved["colouring"]) ?? fallback.colouring,
    theme: oneOf(THEMES, saved["theme"]) ?? fallback.theme,
    show: {
      result: flag(show["result"], true),
      truth: flag(show["truth"], true),
      signal: flag(show["signal"], true),
    },
  };
}

export function ofPerson(settings: Settings): PersonSettings {
  const { height, posture, mirror, regions, smoothing, floor, hold_feet } = settings;
  return { height, posture, mirror, regions, smoothing, floor, hold_feet };
}

export function loadSettings(storage: Pick<Storage, "getItem">): Settings {
  return settingsFrom(storage.getItem(KEY));
}

export function saveSettings(storage: Pick<Storage, "setItem">, settings: Settings): void {
  storage.setItem(KEY, JSON.stringify(settings));
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

function isHeight(value: unknown): value is number {
  return typeof value === "number" && value >= HEIGHTS.least && value <= HEIGHTS.most;
}

function isHalfLife(value: unknown): value is number {
  return typeof value === "number" && value >= 0 && value <= SLOWEST;
}

function isFloor(value: unknown): value is number {
  return typeof value === "number" && Math.abs(value) <= DEEPEST_FLOOR;
}

function flag(value: unknown, fallback: boolean): boolean {
  return typeof value === "boolean" ? value : fallback;
}

function listOf(value: unknown): string[] | undefined {
  return Array.isArray(value) && value.every((entry) => typeof entry === "string") ? value : undefined;
}

function oneOf<T extends string>(choices: readonly T[], value: unknown): T | undefined {
  return choices.find((choice) => choice === value);
}
