import { PerspectiveCamera, Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { CONTACT_SHADOWS, ContactShadow } from "../../src/view/contact_shadow";

const NAMES = ["left_hip", "right_hip", "left_ankle", "right_ankle", "left_toe", "right_toe"];
/** Feet 0.2 m apart; the right one stands ahead by `ahead` m, the left one is lifted by `lift` m and turned by `turn`. */
const body = (ahead: number, lift: number, turn = 0) => ({
  position: Float32Array.from(
    [
      [0.1, 0.9, 0],
      [-0.1, 0.9, 0],
      [0.1, lift + 0.08, 0],
      [-0.1, 0.08, ahead],
      [0.1 + 0.2 * Math.sin(turn), lift, 0.2 * Math.cos(turn)],
      [-0.1, 0, 0.2 + ahead],
    ].flat(),
  ),
  rotation: new Float32Array(),
});
const spots = (...given: Parameters<typeof body>) => {
  const shadow = new ContactShadow();
  shadow.show(body(...given), NAMES);
  shadow.group.updateMatrixWorld(true);
  return shadow.spots;
};

describe("contact shadows", () => {
  it("lie on the floor below the middle of each foot and of the hips", () => {
    const [left, right, hips] = spots(0.3, 0.1).map(({ position }) => position.toArray());
    expect([left, hips].flat().map((place) => +place.toFixed(6))).toEqual([0.1, 0, 0.1, 0, 0, 0]);
    expect(right.map((place) => +place.toFixed(6))).toEqual([-0.1, 0, 0.4]);
  });

  it("are as long as the foot, along it", () => {
    const turned = spots(0, 0, Math.PI / 2)[0];
    const heel = new Vector3(0, 0, -0.5).applyMatrix4(turned.matrixWorld);
    expect(heel.x).toBeLessThan(0); // 10 cm behind the ankle
    expect(Math.abs(heel.z)).toBeLessThan(1e-6);
  });

  it("fade as a foot is lifted, and are gone high above the floor", () => {
    const darkness = [0, 0.1, 0.3, 0.6].map((lift) => spots(0, lift)[0].material.opacity);
    expect(darkness[0]).toBeGreaterThan(darkness[1]);
    expect(darkness[1]).toBeGreaterThan(darkness[2]);
    expect(darkness[3]).toBe(0);
    expect(spots(0, -0.02)[0].material.opacity).toBe(darkness[0]); // a toe below the floor
  });

  it("are drawn by cameras that ask for them alone", () => {
    const camera = new PerspectiveCamera();
    const drawn = () => spots(0, 0).filter(({ layers }) => layers.test(camera.layers)).length;
    expect(drawn()).toBe(0);
    camera.layers.enable(CONTACT_SHADOWS);
    expect(drawn()).toBe(3);
  });
});
