/** The core: what of a step is outside the network's graph. */

import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { calibrated } from "../src/core/calibration";
import { interval } from "../src/core/clock";
import { axisAngle, cholesky, forward, fromAxes, multiply, rotate, solve, type Vector } from "../src/core/math";
import { numbers, readNpz } from "../src/core/npz";
import type { Observation } from "../src/core/observation";
import { fillPoints, Growing, NOBODY, noPoints, personOf } from "../src/core/person";
import { placed, placedBy } from "../src/core/placement";
import { ShapeSpace } from "../src/core/shape";
import { completionCard } from "../src/engine/card";
import { XrPoints } from "../src/sources/xr_points";
import { XR_POINTS } from "../src/sources/xr_signal";
import { skeleton } from "./body";

const library = (name: string): ArrayBuffer =>
  Uint8Array.from(readFileSync(new URL(`../../src/bodysense/${name}`, import.meta.url))).buffer;
const space = new ShapeSpace(await readNpz(library("body/shape_space.npz")), skeleton);
const standing = (time: number, head: Vector, span = 1.4): Observation => ({
  time,
  points: [
    { name: "head", position: head, rotation: [1, 0, 0, 0], accuracy: 0.001 },
    { name: "left_wrist", position: [span / 2, 1.4, 0], rotation: null, accuracy: 0.001 },
    { name: "right_wrist", position: [-span / 2, 1.4, 0], rotation: null, accuracy: 0.001 },
  ],
});

it("a factor gives what solving gives: values by the inverse, by values", () => {
  const random = (k: number): number => Math.sin(97 * k) * 2;
  const rows = [0, 1, 2, 3, 4].map((i) => [0, 1, 2, 3, 4].map((j) => random(5 * i + j)));
  const matrix = rows.map((a, i) =>
    Float64Array.from(rows, (b, j) => a.reduce((sum, x, k) => sum + x * (b[k] ?? 0), i === j ? 1 : 0)),
  );
  const values = Float64Array.from({ length: 5 }, (_, k) => random(40 + k));
  const solved = solve(
    matrix.map((row) => row.slice()),
    values.slice(),
  );
  const expected = values.reduce((sum, value, k) => sum + value * (solved[k] ?? 0), 0);
  expect(Math.hypot(...forward(cholesky(matrix), values.slice())) ** 2).toBeCloseTo(expected, 9);
});

describe("the clock", () => {
  it("tells a gap from a pause, and refuses time that stands", () => {
    expect(interval(5, Number.NaN)).toEqual({ seconds: 1 / 30, isFresh: true });
    expect(interval(5.02, 5).seconds).toBeCloseTo(0.02, 9);
    expect(interval(5.5, 5)).toEqual({ seconds: 0.1, isFresh: false });
    expect(interval(6.5, 5).isFresh).toBe(true);
    expect(() => interval(5, 5)).toThrow("A frame at 5 s came after one at 5 s.");
    expect(() => interval(Number.NaN, 5)).toThrow();
  });
});

describe("proportions", () => {
  it("are the mean adult's where nothing is known, and as tall as told", () => {
    const nobody = space.likeliest([], null);
    expect(space.stature(nobody.restOffset)).toBeGreaterThan(1.6);
    for (const height of [1.5, 1.83, 2.2]) {
      const { restOffset } = space.likeliest([], { value: height, deviation: 0.001 });
      expect(space.stature(restOffset)).toBeCloseTo(height, 3);
    }
  });

  it("grow toward the head that stands there, and not at once", () => {
    const body = new Growing(space, skeleton, NOBODY);
    const before = space.stature(body.shown);
    const frame = noPoints(skeleton);
    fillPoints(frame, standing(0, [0, 1.75, 0]), skeleton);
    body.update(frame, 1 / 60, 0);
    expect(space.stature(body.shown)).toBeCloseTo(before, 6);
    for (let k = 0; k < 600; k++) body.update(frame, 1 / 60, 0);
    expect(space.stature(body.shown)).toBeGreaterThan(1.8);
  });

  it("refuse heights that no person has, in one line", () => {
    for (const height of [0.2, 9, Number.NaN])
      expect(() => personOf(height)).toThrow(/^A height of \S+ m is not a person's; give 1 to 2.3 m\.$/);
    expect(personOf(null)).toEqual(NOBODY);
  });
});

describe("calibration", () => {
  const frames = (head: (k: number) => Vector, span?: number) =>
    Array.from({ length: 60 }, (_, k) => standing(k / 30, head(k), span));

  it("takes the head's height and the reach of arms that are out", () => {
    const person = calibrated(frames(() => [0, 1.62, 0]));
    expect(person.head?.value).toBeCloseTo(1.62, 6);
    expect(person.lengths[0]?.value).toBeCloseTo(1.4, 6);
    expect(calibrated(frames(() => [0, 1.62, 0], 0.5)).lengths).toEqual([]); // hanging arms tell no reach
  });

  it("refuses whoever walks", () => {
    expect(() => calibrated(frames((k) => [k / 100, 1.6, 0]))).toThrow(
      /^Your head moved by \d+ cm: stand still[^\n]*$/,
    );
    expect(() => calibrated([])).toThrow("Your head was not tracked");
  });
});

describe("a headset's points", () => {
  const points = new XrPoints(
    new Map([
      ["between_eyes", [0, 0.04, 0.1]],
      ["left_palm", [0.05, 0, 0]],
    ]),
  );

  it("have the head behind the eyes, facing where the headset looks", () => {
    const [head] = points.read([{ point: 0, position: [0, 1.6, 0], rotation: [1, 0, 0, 0] }], 1); // looks along −Z
    expect(head.name).toBe("head");
    expect(rotate(head.rotation ?? [1, 0, 0, 0], [0, 0, 1]).map((v) => Math.round(v))).toEqual([0, 0, -1]);
    expect(head.position?.map((v) => Math.round(100 * v) / 100 + 0)).toEqual([0, 1.56, 0.1]);
  });

  it("are named as the body's are, and all stand in it", () => {
    const all = points.read(
      XR_POINTS.map((_, point) => ({ point, position: [0, 0, 0], rotation: [1, 0, 0, 0] })),
      1,
    );
    expect(all.every(({ name }) => skeleton.points.includes(name))).toBe(true);
    expect(all.length).toBe(43);
  });

  it("face the front from the first frame on", () => {
    const turn = axisAngle([0, 1, 0], 2);
    const [head] = placed(
      [{ name: "head", position: [3, 1.6, -2], rotation: multiply(turn, axisAngle([1, 0, 0], 0.2)), accuracy: 0.001 }],
      placedBy([3, 1.6, -2], multiply(turn, axisAngle([1, 0, 0], 0.2))),
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

  it("carry a card that says what they are", () => {
    const card = completionCard(new Uint8Array(library("weights/completion.onnx")));
    expect(card["points"]).toEqual(skeleton.points);
    expect(() => completionCard(new Uint8Array(library("weights/arms.onnx")))).toThrow(
      /^completion\.onnx has the format/,
    );
    expect(() => completionCard(Uint8Array.from([255, 255, 255]))).toThrow(/^completion\.onnx is damaged/);
  });
});
