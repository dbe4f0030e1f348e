import { describe, expect, it } from "vitest";
import { DEFAULT_SETTINGS, loadSettings, saveSettings, settingsFrom } from "../src/settings";
import { HAND_JOINTS, HeadsetReader, XR_POINTS } from "../src/sources/xr_signal";
import { legend, pointColour } from "../src/view/colours";
import { Color } from "three";
import { History } from "../src/history";
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
    };
    saveSettings(() => ({ setItem: (key, value) => void kept.set(key, value) }), mine);
    expect(loadSettings(() => ({ getItem: (key) => kept.get(key) ?? null }))).toEqual(mine);
  });

  it.each([null, "", "nonsense", "[]", "null", '"text"', "{}"])("are the default for %j", (text) => {
    expect(settingsFrom(text)).toEqual(DEFAULT_SETTINGS);
  });

  it("take what is valid of what is broken", () => {
    const text = '{"height": 99, "sensors": "tail", "truth": 1, "figure": "figure", "theme": "dark"}';
    expect(settingsFrom(text)).toEqual({ ...DEFAULT_SETTINGS, figure: "figure", theme: "dark" });
  });

  it("say in one line that the storage is full", () => {
    const full = {
      setItem: () => {
        throw new DOMException("full", "QuotaExceededError");
      },
    };
    expect(() => saveSettings(() => full, DEFAULT_SETTINGS)).toThrow(/^This browser's storage is full[^\n]*$/);
  });

  it("are the default's where a browser lets no page store anything, which is said when they change", () => {
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
    expect(new Set(XR_POINTS.map(partOf))).toEqual(new Set(["Head", "Left hand", "Right hand"]));
  });
});

describe("a headset's signal", () => {
  const transform = { position: { x: 1, y: 2, z: 3 }, orientation: { x: 0, y: 0, z: 0, w: 1 } };
  const pose = (emulatedPosition = false) => ({ transform, emulatedPosition }) as unknown as XRViewerPose;
  const space = {} as XRReferenceSpace;
  const source = (part: object) => ({ handedness: "left", ...part }) as unknown as XRInputSource;

  it("names the 25 joints of WebXR", () => {
    expect(new Set(HAND_JOINTS).size).toBe(25);
    expect(XR_POINTS.length).toBe(53);
  });

  it("holds the viewer and a grip, in the order w x y z", () => {
    const frame = { getViewerPose: () => pose(), getPose: () => pose() } as unknown as XRFrame;
    const points = new HeadsetReader().read(frame, space, [source({ gripSpace: {} })]);
    expect(points.map(({ point }) => XR_POINTS[point])).toEqual(["headset", "left_controller"]);
    expect(points[0]).toEqual({ point: 0, position: [1, 2, 3], rotation: [1, 0, 0, 0] });
  });

  it("leaves out what is not tracked", () => {
    const hand = new Map([
      ["wrist", { jointName: "wrist" }],
      ["thumb-tip", { jointName: "thumb-tip" }],
    ]);
    const frame = {
      getViewerPose: () => null,
      getJointPose: (joint: { jointName: string }) => (joint.jointName === "wrist" ? pose() : null),
    } as unknown as XRFrame;
    const points = new HeadsetReader().read(frame, space, [source({ hand }), source({ handedness: "none" })]);
    expect(points.map(({ point }) => XR_POINTS[point])).toEqual(["left:wrist"]);
  });

  it("leaves out guesses of what was measured, and believes a device that only guesses", () => {
    const reader = new HeadsetReader();
    const frame = (isGuess: boolean) =>
      ({ getViewerPose: () => null, getPose: () => pose(isGuess) }) as unknown as XRFrame;
    const counts = [true, false, true].map(
      (isGuess) => reader.read(frame(isGuess), space, [source({ gripSpace: {} })]).length,
    );
    expect(counts).toEqual([1, 1, 0]);
  });
});

describe("colours", () => {
  const history = new History();
  history.add(some(0, 0));
  const [moment] = history.moments;

  it("tell hidden from seen, and sure from unsure", () => {
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
