/** The page's tracker over the core's WebAssembly. That the core's bodies are the library's:
 * tests/web/test_core_package.py */

import { readFileSync } from "node:fs";
import { openModel } from "@bodysense/core";
import { expect, it } from "vitest";
import type { Observation, Point } from "../src/body/observation";
import { place, restPoint, withOffsets } from "../src/body/skeleton";
import { Tracker } from "../src/engine/tracker";
import { DEVIATION } from "../src/wearer/wearer";
import { skeleton } from "./body";

const read = (path: string): Uint8Array<ArrayBuffer> => Uint8Array.from(readFileSync(new URL(path, import.meta.url)));
const model = await openModel(read("../../src/bodysense/weights/completion.safetensors"), read("../core/core.wasm"));

const frame = (time: number, head: number, more: readonly Point[] = []): Observation => ({
  time,
  points: [{ name: "head", position: [0, head, 0], rotation: [1, 0, 0, 0], accuracy: 0.001 }, ...more],
});
const crown = (restOffset: Float32Array): number => restPoint(withOffsets(skeleton, restOffset), "head_top")[1];

it("places joints where the body's own rotations put them", () => {
  const body = new Tracker(model, skeleton).step(frame(0, 1.6));
  const placed = place(withOffsets(skeleton, body.restOffset), body.rootPosition, body.rotation);
  for (const name of ["position", "rotation"] as const)
    body.body[name].forEach((value, k) => expect(value).toBeCloseTo(placed[name][k], 4));
  expect([...body.measured].filter(Boolean)).toHaveLength(1);
});

it("makes a measured wearer as tall as their head is high, from the first frame on", () => {
  const tracker = new Tracker(model, skeleton);
  for (const head of [1.45, 1.75]) {
    tracker.start({ head });
    const { restOffset } = tracker.step(frame(0, head));
    expect(Math.abs(restPoint(withOffsets(skeleton, restOffset), "head")[1] - head)).toBeLessThan(DEVIATION);
  }
});

it("goes on with the same motion when more is known, and begins anew when it starts", () => {
  const tracker = new Tracker(model, skeleton);
  tracker.step(frame(0, 1.6));
  tracker.setPerson({ height: 1.9 });
  for (let k = 1; k < 300; k++) tracker.step(frame(k / 60, 1.6));
  expect(crown(tracker.step(frame(5, 1.6)).restOffset)).toBeCloseTo(1.9, 2);
  expect(() => tracker.step(frame(0, 1.6))).toThrow(/^frame: time is not finite or does not increase/);
  tracker.start({ height: 1.5 });
  expect(crown(tracker.step(frame(0, 1.4)).restOffset)).toBeCloseTo(1.5, 2);
});

it("holds feet, or not, from the next frame on", () => {
  const lowest = (holdFeet: boolean): number => {
    const tracker = new Tracker(model, skeleton);
    tracker.start({ height: 1.9 });
    tracker.step(frame(0, 1.75));
    tracker.holdFeet = holdFeet;
    const { position } = tracker.step(frame(1 / 60, 1.6)).body;
    return Math.min(...skeleton.points.map((_, point) => position[3 * point + 1]));
  };
  expect(Math.abs(lowest(true) - lowest(false))).toBeGreaterThan(0.02);
});

it("leaves out points that the body does not have", () => {
  const hat: Point = { name: "hat", position: [0, 1.9, 0], accuracy: 0.001 };
  const [with_, without] = [[hat], []].map((more) => new Tracker(model, skeleton).step(frame(0, 1.6, more)));
  expect(with_).toEqual(without);
});
