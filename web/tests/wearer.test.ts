/** A wearer: how they are measured, and what a headset tells of them. */

import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { calibrated } from "../src/wearer/calibration";
import { axisAngle, fromAxes, multiply, rotate, type Vector } from "../src/body/math";
import { numbers, readNpz } from "../src/files/npz";
import type { Observation } from "../src/body/observation";
import { applyPlacement, placementAt } from "../src/sources/placement";
import { Measuring } from "../src/wearer/measuring";
import { moved, nameOf, placeOf, PLACES, usualPlace } from "../src/wearer/trackers";
import { DEVIATION, NOBODY, distancesOf, LENGTH_NAMES, LENGTHS, personFrom, personOf } from "../src/wearer/wearer";

const library = (name: string): ArrayBuffer =>
  Uint8Array.from(readFileSync(new URL(`../../src/bodysense/${name}`, import.meta.url))).buffer;
const standing = (time: number, head: Vector, span = 1.4): Observation => ({
  time,
  points: [
    { name: "head", position: head, rotation: [1, 0, 0, 0], accuracy: 0.001 },
    { name: "left_wrist", position: [span / 2, 1.4, 0], rotation: null, accuracy: 0.001 },
    { name: "right_wrist", position: [-span / 2, 1.4, 0], rotation: null, accuracy: 0.001 },
  ],
});

it("heights that no person has are refused in one line", () => {
  for (const height of [0.2, 9, Number.NaN])
    expect(() => personOf(height)).toThrow(/^A height of \S+ m is not a person's; give 1 to 2.3 m\.$/);
  expect(personOf(null)).toEqual(NOBODY);
});

describe("known lengths", () => {
  it("are between points of the body, on both sides", () => {
    const [left, right] = ["left", "right"].map((side) => ({ start: `${side}_hip`, end: `${side}_knee`, value: 0.45 }));
    expect(distancesOf({ thigh: 0.45 })).toEqual([left, right]);
    expect(personFrom(null, null, { thigh: 0.45 })).toEqual({
      lengths: [left, right].map((distance) => ({ ...distance, deviation: DEVIATION })),
    });
    expect(personFrom(null, { head: 1.6, reach: 1.4 }, { reach: 1.5 }).lengths).toEqual([
      { start: "left_wrist", end: "right_wrist", value: 1.5, deviation: DEVIATION },
    ]);
    expect(personFrom(null, null)).toEqual(NOBODY);
  });

  it("that no person has are refused in one line", () => {
    for (const name of LENGTH_NAMES) {
      const { text, least, most } = LENGTHS[name];
      for (const value of [least - 0.01, most + 0.01, Number.NaN, -1])
        expect(() => distancesOf({ [name]: value })).toThrow(
          `${text}: ${value} m is not a person's; give ${least} to ${most} m.`,
        );
      expect(distancesOf({ [name]: least }).length).toBe(LENGTHS[name].pairs.length);
    }
  });
});

describe("trackers", () => {
  it("are worn where their names say", () => {
    for (const joint of Object.keys(PLACES))
      expect([usualPlace(joint), usualPlace(`${joint}_tracker`)]).toEqual([joint, joint]);
    expect(["hip", "waist", "chest", "tracker_3"].map(usualPlace)).toEqual(["pelvis", "pelvis", "spine3", ""]);
    expect(["head", "left_wrist", "left_controller", "headset", "left:wrist", "tracker_x"].map(usualPlace)).toEqual(
      Array(6).fill(null),
    );
    expect([nameOf("left_knee"), nameOf("left_knee_tracker"), nameOf("tracker_3")]).toEqual([
      "Left knee",
      "Left knee tracker",
      "Tracker 3",
    ]);
  });

  it("never share a place, whatever is moved, and come back when all are forgotten", () => {
    const trackers = ["headset", "hip", "left_knee_tracker", "right_knee_tracker", "tracker_1", "tracker_2"];
    const strapped = trackers.slice(1);
    const places = ["", ...Object.keys(PLACES)];
    let worn = {};
    for (let k = 0; k < 500; k++) {
      const [tracker, place] = [strapped[(7 * k + (k >> 3)) % 5], places[(5 * k + (k >> 2)) % 9]];
      worn = moved(trackers, worn, tracker, place);
      expect(placeOf(tracker, worn)).toBe(place);
      const taken = strapped.map((name) => placeOf(name, worn)).filter((joint) => joint !== "");
      expect(new Set(taken).size).toBe(taken.length);
    }
    for (let round = 0; round < 2; round++)
      for (const name of strapped) worn = moved(trackers, worn, name, usualPlace(name) ?? "");
    expect(worn).toEqual({});
  });

  it("swap two places", () => {
    const trackers = ["left_ankle", "right_ankle", "pelvis"];
    expect(moved(trackers, {}, "left_ankle", "right_ankle")).toEqual({
      left_ankle: "right_ankle",
      right_ankle: "left_ankle",
    });
  });
});

describe("calibration", () => {
  const frames = (head: (k: number) => Vector, span?: number) =>
    Array.from({ length: 60 }, (_, k) => standing(k / 30, head(k), span));

  it("takes the head's height and the reach of arms that are out", () => {
    const person = calibrated(frames(() => [0, 1.62, 0]));
    expect(person.head).toBeCloseTo(1.62, 6);
    expect(person.reach).toBeCloseTo(1.4, 6);
    expect(calibrated(frames(() => [0, 1.62, 0], 0.5)).reach).toBeNull(); // hanging arms tell no reach
  });

  it("refuses whoever walks", () => {
    expect(() => calibrated(frames((k) => [k / 100, 1.6, 0]))).toThrow(
      /^Your head moved by \d+ cm: stand still[^\n]*$/,
    );
    expect(() => calibrated([])).toThrow("Your head was not tracked");
  });
});

describe("measuring", () => {
  it("does not go on in the next session", () => {
    const said: string[] = [];
    const measuring = new Measuring((text) => said.push(text));
    measuring.start();
    for (let k = 0; k < 120; k++) expect(measuring.take(standing(k / 30, [0, 1.6, 0]))).toBeNull(); // 4 s of 5
    expect(said.at(-1)).toMatch(/^Hold still/);
    measuring.stop();
    const before = said.length;
    for (let k = 0; k < 60; k++) expect(measuring.take(standing(10 + k / 30, [1, 1.6, 0]))).toBeNull();
    expect(said.length).toBe(before);
  });
});

describe("a wearer", () => {
  it("face the front from the first frame on", () => {
    const turn = axisAngle([0, 1, 0], 2);
    const [head] = applyPlacement(
      [{ name: "head", position: [3, 1.6, -2], rotation: multiply(turn, axisAngle([1, 0, 0], 0.2)), accuracy: 0.001 }],
      placementAt([3, 1.6, -2], multiply(turn, axisAngle([1, 0, 0], 0.2))),
    );
    const [x, , z] = rotate(head.rotation ?? [1, 0, 0, 0], [0, 0, 1]);
    expect([Math.atan2(x, z), head.position?.[0], head.position?.[2]].map((v) => Math.abs(v ?? 1) < 1e-9)).toEqual([
      true,
      true,
      true,
    ]);
  });
});

describe("rotations", () => {
  it("come from their axes", () => {
    for (let k = 0; k < 20; k++) {
      const turn = multiply(axisAngle([0, 1, 0], k), axisAngle([1, 0, 0], 2 * k));
      const found = fromAxes(rotate(turn, [1, 0, 0]), rotate(turn, [0, 1, 0]), rotate(turn, [0, 0, 1]));
      expect(Math.abs(found.reduce((sum, value, i) => sum + value * turn[i], 0))).toBeCloseTo(1, 9);
    }
  });
});

describe("files of the library", () => {
  it("are read as NumPy wrote them", async () => {
    const archive = await readNpz(library("demo/performance.npz"));
    expect(numbers(archive, "poses").shape).toEqual([750, 156]);
    await expect(readNpz(new ArrayBuffer(40))).rejects.toThrow("no .npz archive");
    const cut = library("demo/performance.npz").slice(0, 5000);
    await expect(readNpz(cut)).rejects.toThrow("no .npz archive");
  });
});
