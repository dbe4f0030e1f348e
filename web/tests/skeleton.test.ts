import { Object3D, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { meanDistance, place, restHeight, restPoint, rootHeight, stature } from "../src/body/skeleton";
import { moment, skeleton } from "./body";

describe("forward kinematics", () => {
  it.each([0, 1, 2])("agrees with a scene graph of three.js (pose %i)", (seed) => {
    const { rootPosition, rotation } = moment(seed, 0, 3);
    const body = place(skeleton, rootPosition, rotation);
    const nodes = skeleton.points.map(() => new Object3D());
    skeleton.parents.forEach((parent, point) => {
      nodes[point].position.fromArray(parent < 0 ? rootPosition : skeleton.restOffset, parent < 0 ? 0 : 3 * point);
      const [w, x, y, z] = rotation.subarray(4 * point);
      if (point < skeleton.joints) nodes[point].quaternion.set(x, y, z, w);
      if (parent >= 0) nodes[parent].add(nodes[point]);
    });
    nodes[0].updateMatrixWorld(true);
    nodes.forEach((node, point) => {
      const there = node.getWorldPosition(new Vector3());
      expect(there.distanceTo(new Vector3().fromArray(body.position, 3 * point))).toBeLessThan(1e-5);
    });
  });

  it("knows how tall an adult is", () => {
    expect(Math.abs(restHeight(skeleton) - 1.7)).toBeLessThan(0.03); // m, docs/conventions.md; soles are no points
    expect(Math.abs(rootHeight(skeleton) / restHeight(skeleton) - 0.53)).toBeLessThan(0.06);
  });

  it("measures a shift as its length", () => {
    const { rotation } = moment(0, 0);
    const [here, there] = [place(skeleton, [0, 0, 0], rotation), place(skeleton, [0.03, 0, 0.04], rotation)];
    expect(meanDistance(here, there, skeleton.joints)).toBeCloseTo(0.05, 5);
  });
});

it("a person's height is that of the crown over the soles, which the lowest point is above", () => {
  expect(stature(skeleton)).toBe(restPoint(skeleton, "head_top")[1]);
  expect(stature(skeleton) - restHeight(skeleton)).toBeGreaterThan(0.005);
});
