/** The box under a body that sits. */

import { describe, expect, it } from "vitest";
import type { Vector } from "../../src/body/math";
import { place, type Body } from "../../src/body/skeleton";
import { Seat, seatUnder } from "../../src/view/seat";
import { skeleton } from "../body";

const about = (angle: number): readonly number[] => [Math.cos(angle / 2), Math.sin(angle / 2), 0, 0];

/** A body whose thighs are raised and whose knees are bent by an angle, its ankles on the floor. */
function bent(thigh: number, knee: number): Body {
  const rotation = new Float32Array(4 * skeleton.joints);
  for (let joint = 0; joint < skeleton.joints; joint++) rotation[4 * joint] = 1;
  for (const side of ["left", "right"]) {
    rotation.set(about(-thigh), 4 * skeleton.points.indexOf(`${side}_hip`));
    rotation.set(about(knee), 4 * skeleton.points.indexOf(`${side}_knee`));
  }
  const body = place(skeleton, Float32Array.of(0, 0, 0), rotation);
  const ankle = 3 * skeleton.points.indexOf("left_ankle") + 1;
  return place(skeleton, Float32Array.of(0, 0.08 - body.position[ankle], 0), rotation);
}

describe("a seat", () => {
  it.each([0.9, 1.2, 1.45])("is under hips whose thighs are raised by %f rad", (thigh) => {
    const body = bent(thigh, thigh);
    const hip = body.position[3 * skeleton.points.indexOf("left_hip") + 1];
    const seat = seatUnder(body, skeleton);
    expect(seat?.at[1]).toBeCloseTo(hip - 0.095, 5);
    expect(seat?.turn).toBeCloseTo(0, 5);
  });

  it.each([
    ["who stands", 0, 0],
    ["who walks", 0.4, 0.3],
    ["who squats, over their feet", 1.9, 2.5],
  ])("is not under somebody %s", (_, thigh, knee) => {
    expect(seatUnder(bent(thigh, knee), skeleton)).toBeNull();
  });

  it("comes when somebody has settled, stays while they sway, and goes when they rise", () => {
    const seat = new Seat();
    const [sat, stood] = [bent(1.4, 1.4), bent(0, 0)];
    const after = (body: Body, frames: number): boolean => {
      for (let k = 0; k < frames; k++) seat.show(body, skeleton, 0.1);
      return seat.group.visible;
    };
    expect(after(sat, 2)).toBe(false);
    expect(after(sat, 5)).toBe(true);
    const before: Vector = [seat.group.position.x, seat.group.position.y, seat.group.position.z];
    expect(after({ ...sat, position: sat.position.map((value, k) => value + (k % 3 === 0 ? 0.05 : 0)) }, 5)).toBe(true);
    expect(seat.group.position.x).toBe(before[0]);
    expect(after(stood, 1)).toBe(false);
  });

  it("comes under hips that rest over their feet, not under a squat, and cuts no shins", () => {
    const after = (body: Body, frames: number): Seat => {
      const seat = new Seat();
      for (let k = 0; k < frames; k++) seat.show(body, skeleton, 0.1);
      return seat;
    };
    const [over, squat] = [bent(1.2, 1.9), bent(1.9, 2.6)];
    expect(seatUnder(over, skeleton)).toBeNull();
    expect(after(over, 15).group.visible).toBe(false);
    expect(after(squat, 50).group.visible).toBe(false);
    const { group } = after(over, 30);
    expect(group.visible).toBe(true);
    const ankle = over.position[3 * skeleton.points.indexOf("left_ankle") + 2];
    expect(group.position.z + 0.21).toBeLessThan(ankle);
  });
});
