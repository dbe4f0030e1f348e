/** Landmarks of a webcam as points of the body. */

import { describe, expect, it } from "vitest";
import { readFileSync } from "node:fs";
import type { Landmarks } from "../../src/sources/webcam/landmark_marks";
import { LandmarkPoints } from "../../src/sources/webcam/landmarks";
import type { Vector } from "../../src/body/math";
import { skeleton } from "../body";

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

/** Somebody in the T-pose `away` m before a camera at the height of their pelvis, `lower` m below their own height. */
function seen(away = AWAY, lower = 0): { readonly landmarks: Landmarks; readonly rest: (name: string) => Vector } {
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
  const picture = world.map(([a, b, c]) => [(FOCAL * a) / (away - c), (FOCAL * (b - lower)) / (away - c)] as const);
  return { landmarks: { world, picture, visible: world.map(() => 0.99) }, rest };
}

/** The head's place after pictures, 15 a second. */
function headAfter(pictures: readonly Landmarks[], body = (_: number) => skeleton): Vector {
  const points = new LandmarkPoints(FOCAL);
  const heads = pictures.map((one, k) =>
    points.read(one, one, body(k), k && 1 / 15, k / 15)?.find(({ name }) => name === "head"),
  );
  return heads.at(-1)?.position ?? [NaN, NaN, NaN];
}

describe("landmarks of somebody who stands", () => {
  it("put the body on the floor", () => {
    const { landmarks, rest } = seen();
    const points = new LandmarkPoints(FOCAL).read(landmarks, landmarks, skeleton, 0.03, 0) ?? [];
    for (const name of ["left_ankle", "right_ankle", "left_knee", "left_wrist", "head"]) {
      const height = points.find((point) => point.name === name)?.position?.[1] ?? Number.NaN;
      expect([name, Math.abs(height - rest(name)[1])]).toEqual([name, expect.closeTo(0, 1)]);
    }
  });
});

describe("somebody who moves", () => {
  const speed = 0.9; // m/s
  const walk = Array.from({ length: 30 }, (_, k) => seen(AWAY - (speed * k) / 15).landmarks);

  it("is not behind: a steady walk to the camera", () => {
    const [, , z] = headAfter(walk);
    const [, , before] = headAfter(walk.slice(0, 1));
    expect(z - before).toBeCloseTo((speed * 29) / 15, 1.5);
  });

  it("keeps the place where the tracker infers another height", () => {
    const smaller = { ...skeleton, restOffset: skeleton.restOffset.map((value) => 0.9 * value) };
    const [, , z] = headAfter(
      walk.map(() => walk[0]),
      (k) => (k < 15 ? skeleton : smaller),
    );
    expect(z).toBeCloseTo(0.9 * headAfter(walk.slice(0, 1))[2], 2);
  });

  it("sits down where the picture says so, though a leg is hidden", () => {
    const hidden = (one: Landmarks): Landmarks => ({
      ...one,
      visible: one.visible.map((value, k) => ([25, 26, 27, 28].includes(k) ? 0.1 : value)),
    });
    const [, standing] = headAfter(walk.slice(0, 1));
    const sitting = [0.1, 0.2, 0.3, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4, 0.4].map((lower) =>
      hidden(seen(AWAY, lower).landmarks),
    );
    const [, height] = headAfter([...walk.slice(0, 1), ...sitting]);
    expect(height).toBeCloseTo(standing - 0.4, 1);
    expect(headAfter(sitting)[1]).toBeLessThan(standing - 0.25); // whose legs were never seen sits
  });
});

describe("the library's bodies of the same landmarks", () => {
  interface Expected extends Landmarks {
    readonly height: Readonly<Record<string, number>>; // m
  }
  const path = new URL("landmarks.json", import.meta.url);
  const { focal, frames, rate, people } = JSON.parse(readFileSync(path, "utf8")) as {
    readonly focal: number;
    readonly frames: number;
    readonly rate: number;
    readonly people: Readonly<Record<string, Expected>>;
  };

  it.each(Object.keys(people))("are the page's: %s", (name) => {
    const points = new LandmarkPoints(focal);
    const { height, ...landmarks } = people[name];
    const seen = Array.from({ length: frames }, (_, k) =>
      points.read(landmarks, landmarks, skeleton, k && 1 / rate, k / rate),
    ).at(-1);
    for (const [point, metres] of Object.entries(height)) {
      const found = seen?.find((one) => one.name === point)?.position?.[1] ?? Number.NaN;
      expect([point, Math.abs(found - metres)]).toEqual([point, expect.closeTo(0, 1.4)]);
    }
  });
});
