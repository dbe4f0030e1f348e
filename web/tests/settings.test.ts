import { describe, expect, it } from "vitest";
import { DEFAULT_SETTINGS, loadSettings, saveSettings, settingsFrom } from "../src/settings";
import { legend, pointColour } from "../src/view/colours";
import { Color } from "three";
import { History } from "../src/takes/history";
import { partOf } from "../src/ui/sensor_panel";
import { moment as some, skeleton } from "./body";

describe("settings", () => {
  it("come back as they were saved", () => {
    const kept = new Map<string, string>();
    const mine = {
      ...DEFAULT_SETTINGS,
      height: 1.83,
      sensors: "feet" as const,
      truth: true,
      mirroredWebcam: false,
      lengths: { thigh: 0.44 },
      trackerNames: { tracker_1: "Blue" },
    };
    saveSettings(() => ({ setItem: (key, value) => void kept.set(key, value) }), mine);
    expect(loadSettings(() => ({ getItem: (key) => kept.get(key) ?? null }))).toEqual(mine);
  });

  it.each([null, "", "nonsense", "[]", "null", '"text"', "{}"])("are the default for %j", (text) => {
    expect(settingsFrom(text)).toEqual(DEFAULT_SETTINGS);
  });

  it("take what is valid of what is broken", () => {
    const text =
      '{"height": 99, "sensors": "tail", "truth": 1, "figure": "figure", "theme": "dark", "lengths": {"shin": 0.4, "thigh": 7, "tail": 1}, "trackerNames": {"a": "b", "c": 3}}';
    expect(settingsFrom(text)).toEqual({
      ...DEFAULT_SETTINGS,
      figure: "figure",
      theme: "dark",
      lengths: { shin: 0.4 },
      trackerNames: { a: "b" },
    });
  });

  it("say in one line that the storage is full", () => {
    const full = {
      setItem: () => {
        throw new DOMException("full", "QuotaExceededError");
      },
    };
    expect(() => saveSettings(() => full, DEFAULT_SETTINGS)).toThrow(/^This browser's storage is full[^\n]*$/);
  });

  it("are the defaults if a browser stores nothing for pages, which is reported when they change", () => {
    const refused = (): never => {
      throw new DOMException("no", "SecurityError");
    };
    expect(loadSettings(refused)).toEqual(DEFAULT_SETTINGS);
    expect(() => saveSettings(refused, DEFAULT_SETTINGS)).toThrow(/^This browser lets the page store nothing[^\n]*$/);
  });
});

describe("parts of the body", () => {
  it("hold every point of the body, and a headset's", () => {
    expect([...new Set(skeleton.points.map(partOf))].sort()).toEqual([
      "Head",
      "Left arm",
      "Left hand",
      "Left leg",
      "Right arm",
      "Right hand",
      "Right leg",
      "Torso",
    ]);
    expect(new Set(["headset", "left_controller", "right:thumb-tip"].map(partOf))).toEqual(
      new Set(["Head", "Left hand", "Right hand"]),
    );
  });
});

describe("colours", () => {
  const history = new History();
  history.add(some(0, 0));
  const [moment] = history.moments;

  it("distinguish hidden from seen, and sure from unsure", () => {
    const seen = { ...moment, measured: new Uint8Array(skeleton.points.length).fill(1) };
    const unsure = { ...moment, expected: new Float32Array(skeleton.points.length).fill(0.3) };
    const hex = (of: typeof moment, how: "hidden" | "confidence") =>
      pointColour(of, 4, how, new Color()).getHexString();
    expect(hex(moment, "hidden")).not.toBe(hex(seen, "hidden"));
    expect(hex(moment, "confidence")).not.toBe(hex(unsure, "confidence"));
  });

  it("fall back to plain without a truth, and have a legend where they mean something", () => {
    expect(pointColour(moment, 4, "error", new Color())).toEqual(pointColour(moment, 4, "plain", new Color()));
    expect(legend("plain")).toBeNull();
    expect(legend("confidence")?.css).toContain("linear-gradient");
  });
});
