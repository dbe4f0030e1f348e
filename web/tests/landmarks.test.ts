/** Landmarks of a webcam as points of the body. */

import { describe, expect, it } from "vitest";
import { LandmarkPoints, type Landmarks } from "../src/sources/landmarks";
import type { Vector } from "../src/body/math";
import { skeleton } from "./body";

const AWAY = 3; // m
const FOCAL = 1.1; // heights of the picture
const PLACES: Readonly<Record<number, string>> = {
  11: "left_shoulder",
  12: "right_shoulder",
  13: "left_elbow",
  14: "right_elbow",
  15: "left_wrist",
  16: "right_wrist",
  17: "left_pinky1",
  18: "right_pinky1",
  19: "left_index1",
  20: "right_index1",
  23: "left_hip",
  24: "right_hip",
  25: "left_knee",
  26: "right_knee",
  27: "left_ankle",
  28: "right_ankle",
  31: "left_toe",
  32: "right_toe",
};

/** Somebody in the T-pose before a camera at the height of their pelvis. */
function seen(): { readonly landmarks: Landmarks; readonly rest: (name: string) => Vector } {
  const { points, parents, restOffset } = skeleton;
  const rest = (name: string): Vector => {
    const place: [number, number, number] = [0, 0, 0];
    for (let point = points.indexOf(name); point >= 0; point = parents[point])
      for (const k of [0, 1, 2]) place[k] += restOffset[3 * point + k];
    return place;
  };
  const [, up] = rest("pelvis");
  const [x, y, z] = rest("head");
  const face: Readonly<Record<number, Vector>> = { 0: [x, y, z + 0.1], 7: [x + 0.07, y, z], 8: [x - 0.07, y, z] };
  const world = Array.from({ length: 33 }, (_, k): Vector => {
    const [a, b, c] = face[k] ?? rest(PLACES[k] ?? "pelvis");
    return [a, b - up, c];
  });
  const picture = world.map(([a, b, c]) => [(FOCAL * a) / (AWAY - c), (FOCAL * b) / (AWAY - c)] as const);
  return { landmarks: { world, picture, visible: world.map(() => 0.99) }, rest };
}

describe("landmarks of somebody who stands", () => {
  it("put the body on the floor", () => {
    const { landmarks, rest } = seen();
    const points = new LandmarkPoints(FOCAL).read(landmarks, skeleton, 0.03) ?? [];
    for (const name of ["left_ankle", "right_ankle", "left_knee", "left_wrist", "head"]) {
      const height = points.find((point) => point.name === name)?.position?.[1] ?? Number.NaN;
      expect([name, Math.abs(height - rest(name)[1])]).toEqual([name, expect.closeTo(0, 1)]);
    }
  });
});
