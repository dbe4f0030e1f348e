/** A wearer: how they are measured, and what a headset tells of them. */

import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { calibrated } from "../src/wearer/calibration";
import { axisAngle, fromAxes, multiply, rotate, type Vector } from "../src/body/math";
import { numbers, readNpz } from "../src/files/npz";
import type { Observation } from "../src/body/observation";
import { applyPlacement, placementAt } from "../src/sources/placement";
import { NOBODY, personOf } from "../src/wearer/wearer";

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
