/** Hands by webcam: whose they are, their fingers as points, and the body that follows them. */

import { readFileSync } from "node:fs";
import { openModel } from "@bodysense/core";
import { describe, expect, it, vi } from "vitest";
import {
  add,
  axisAngle,
  distance,
  multiply,
  quaternionAt,
  rotate,
  scaled,
  subtract,
  unit,
  vectorAt,
} from "../../src/body/math";
import type { Quaternion, Vector } from "../../src/body/math";
import { restOf } from "../../src/body/skeleton";
import { Tracker } from "../../src/engine/tracker";
import { fingerPoints, handsOf, layHand, type Hand } from "../../src/sources/webcam/hands";
import { Laid } from "../../src/sources/webcam/laid";
import { mark, SIDES, type Landmarks, type Side } from "../../src/sources/webcam/landmark_marks";
import { LandmarkPoints } from "../../src/sources/webcam/landmarks";
import { numbers, skeleton } from "../body";

vi.setConfig({ testTimeout: 60_000 });

const FOCAL = 1.1; // heights of the picture
const AWAY = 2; // m
const rest = restOf(skeleton);
const read = (path: string): Uint8Array<ArrayBuffer> => Uint8Array.from(readFileSync(new URL(path, import.meta.url)));

/** The points of a hand from its wrist, turned, with fingers curled by an angle at each joint; `size` stretches it. */
function handPoints(side: Side, turn: Quaternion, curl: number, size = 1): Vector[] {
  const names = fingerPoints(side);
  const places: Vector[] = [[0, 0, 0]];
  const across: Vector = [0, 0, 1];
  names.forEach((name, k) => {
    const isFirst = k % 4 === 0;
    const bone = subtract(rest(name), rest(isFirst ? `${side}_wrist` : names[k - 1]));
    const angle = isFirst ? 0 : (side === "left" ? -1 : 1) * curl * (k % 4);
    const bent = rotate(axisAngle(across, angle), bone);
    places.push(add(places[isFirst ? 0 : k], scaled(rotate(turn, bent), size)));
  });
  return places;
}

/** Somebody in the T-pose before a camera at the height of the pelvis, with hands at the wrists. */
function person(hands: Partial<Record<Side, readonly Vector[]>>): { landmarks: Landmarks; found: Hand[] } {
  const [, up] = rest("pelvis");
  const PARTS: Readonly<Record<string, string>> = { pinky: "pinky1", index: "index1", thumb: "thumb3", heel: "ankle" };
  const world: Vector[] = Array.from({ length: 33 }, () => [0, 0, 0]);
  const [x, y, z] = rest("head");
  world[0] = [x, y - up, z + 0.1];
  world[7] = [x + 0.07, y - up, z];
  world[8] = [x - 0.07, y - up, z];
  for (const side of SIDES)
    for (const part of [
      "shoulder",
      "elbow",
      "wrist",
      "pinky",
      "index",
      "thumb",
      "hip",
      "knee",
      "ankle",
      "heel",
      "toe",
    ] as const) {
      const [a, b, c] = rest(`${side}_${PARTS[part] ?? part}`);
      world[mark(side, part)] = [a, b - up, c];
    }
  const seen = ([a, b, c]: Vector) => [(FOCAL * a) / (AWAY - c), (FOCAL * b) / (AWAY - c)] as const;
  const found = SIDES.flatMap((side): Hand[] => {
    const points = hands[side];
    if (!points) return [];
    const wrist = world[mark(side, "wrist")];
    return [{ world: points, picture: points.map((at) => seen(add(wrist, at))), left: side === "left" ? 0.9 : 0.1 }];
  });
  return { landmarks: { world, picture: world.map(seen), visible: world.map(() => 0.99) }, found };
}

describe("fingers of a hand in any turn, with any curl", () => {
  const next = numbers(7);
  const cases = Array.from({ length: 20 }, (_, k) => ({
    side: SIDES[k % 2],
    turn: axisAngle(unit([next(), next(), next()]), 3 * next()),
    curl: 0.4 + 0.4 * next(),
    size: 1 + 0.2 * next(),
  }));

  it.each(cases)("are laid with their own bones %#", ({ side, turn, curl, size }) => {
    const laid = new Laid();
    laid.put(`${side}_wrist`, [0.5, 0.2, -0.1], 0.9);
    const world = handPoints(side, turn, curl, size).map((place) => add(place, [0.1, 0.2, 0.3])); // from its middle
    layHand(side, { world, picture: [], left: 0.5 }, skeleton, laid);
    const truth = handPoints(side, turn, curl);
    fingerPoints(side).forEach((name, k) => {
      expect(distance(laid.at(name), add([0.5, 0.2, -0.1], truth[k + 1]))).toBeLessThan(1e-6);
      expect(laid.visible(name)).toBe(0.9);
    });
  });
});

describe("hands in a picture", () => {
  const upright: Quaternion = [1, 0, 0, 0];
  const both = { left: handPoints("left", upright, 0.3), right: handPoints("right", upright, 0.3) };
  const { landmarks, found } = person(both);
  const [left, right] = found;

  it("belong to the wrist that they are at, in any order and with doubtful labels", () => {
    for (const hands of [
      [left, right],
      [right, left],
      [
        { ...left, left: 0.3 },
        { ...right, left: 0.7 },
      ],
    ])
      expect(handsOf(landmarks, hands)).toEqual({
        left: hands.find(({ world }) => world === left.world),
        right: hands.find(({ world }) => world === right.world),
      });
  });

  it("are one where they were found twice, and nobody's where they are far from both wrists", () => {
    const again = { ...left, left: 0.4 };
    expect(handsOf(landmarks, [left, again])).toEqual({ left, right: undefined });
    const away = { ...left, picture: left.picture.map(([x, y]) => [x, y + 1] as const) };
    expect(handsOf(landmarks, [away])).toEqual({ left: undefined, right: undefined });
    expect(handsOf(landmarks, [])).toEqual({ left: undefined, right: undefined });
  });

  it("are points of the body where they are seen", () => {
    const seen = { ...landmarks, hands: { left } };
    const points = new LandmarkPoints(FOCAL).read(seen, seen, skeleton, 0.03, 0) ?? [];
    const names = points.map(({ name }) => name);
    expect(names.filter((name) => fingerPoints("left").includes(name))).toHaveLength(20);
    expect(names.filter((name) => fingerPoints("right").includes(name))).toHaveLength(0);
  });

  it("curl the fingers of the body, and leave them where they are lost", async () => {
    const model = await openModel(
      read("../../../src/bodysense/weights/completion.safetensors"),
      read("../../core/core.wasm"),
    );
    const tracker = new Tracker(model, skeleton);
    const source = new LandmarkPoints(FOCAL);
    const bendOf = (curl: number | null): number => {
      let bend = 0;
      for (let k = 0; k < 30; k++) {
        const hands = curl === null ? {} : { left: { ...left, world: handPoints("left", upright, curl) } };
        const seen = { ...landmarks, hands };
        const points = source.read(seen, seen, skeleton, 1 / 30, (clock += 1 / 30)) ?? [];
        const { body } = tracker.step({ time: clock, points });
        const at = (name: string) => vectorAt(body.position, skeleton.points.indexOf(name));
        const [a, b] = [
          ["left_index1", "left_wrist"],
          ["left_index_tip", "left_index3"],
        ].map(([to, from]) => unit(subtract(at(to), at(from))));
        bend = Math.acos(Math.min(1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2]));
      }
      return bend;
    };
    let clock = 0;
    const [open, fist] = [bendOf(0.02), bendOf(0.5)];
    expect(open).toBeLessThan(0.35);
    expect(fist).toBeGreaterThan(1.1);
    expect(bendOf(null)).toBeLessThan(3); // no leap to impossible fingers
  });
});

describe("a turned palm", () => {
  it("turns the wrist", () => {
    const turn = multiply(axisAngle([1, 0, 0], 1), axisAngle([0, 1, 0], 0.4));
    const laid = new Laid();
    laid.put("right_wrist", [0, 0, 0], 1);
    layHand("right", { world: handPoints("right", turn, 0.2), picture: [], left: 0 }, skeleton, laid);
    const found = laid.rotation.get("right_wrist") ?? quaternionAt([1, 0, 0, 0], 0);
    expect(Math.abs(found.reduce((sum, value, k) => sum + value * turn[k], 0))).toBeCloseTo(1, 6);
  });
});
