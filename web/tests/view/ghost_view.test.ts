import { Box3, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { axisAngle } from "../../src/body/math";
import type { Point } from "../../src/body/observation";
import { GhostView } from "../../src/view/ghost_view";

const point = (name: string, x: number, rotation: Point["rotation"] = [1, 0, 0, 0]): Point => ({
  name,
  position: [x, 1.5, 0],
  rotation,
  accuracy: 0.001,
});
const visible = (view: GhostView) => view.group.children.filter(({ visible }) => visible);

describe("ghosts", () => {
  it("are where devices are, and go with what is lost", () => {
    const view = new GhostView();
    const [head, left, right, hip] = ["head", "left_wrist", "right_wrist", "pelvis"].map((name, k) => point(name, k));
    view.show([head, left, right, hip]);
    expect(visible(view).map(({ position }) => position.x)).toEqual([0, 1, 2, 3]);
    view.show([head, { ...left, position: null }]);
    expect(visible(view).map(({ position }) => position.x)).toEqual([0]);
    view.show([head, left]);
    expect(view.group.children).toHaveLength(4); // the same ones again
  });

  it("have the headset before the eyes, whichever way the head looks", () => {
    const view = new GhostView();
    view.show([point("head", 0, axisAngle([0, 1, 0], Math.PI / 2))]); // looks along +X
    view.group.updateMatrixWorld(true);
    const middle = new Box3().setFromObject(view.group.children[0].children[0]).getCenter(new Vector3());
    expect(middle.x).toBeGreaterThan(0.1);
    expect(Math.abs(middle.z)).toBeLessThan(0.01);
    expect(middle.y).toBeGreaterThan(1.55);
  });

  it("are not drawn for hands and pictures, which are many points", () => {
    const view = new GhostView();
    view.show(Array.from({ length: 16 }, (_, k) => point(`left_index${k}`, k)));
    expect(visible(view)).toEqual([]);
  });
});
