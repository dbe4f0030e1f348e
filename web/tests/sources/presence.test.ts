import { expect, it } from "vitest";
import { Presence } from "../../src/sources/webcam/presence";

/** Return whether a person counts as present after each picture. */
function believed(pictures: readonly boolean[], apart: number): boolean[] {
  const presence = new Presence();
  return pictures.map((isSeen, k) => presence.look(isSeen, k * apart));
}

it("keeps a person whom single pictures do not show", () => {
  const pictures = [false, true, false, false, true, false, true, false];
  for (const apart of [30, 2000]) expect(believed(pictures, apart)).toEqual([false, ...Array(7).fill(true)]); // ms
});

it("lets a person go who left, and finds them at once when they come back", () => {
  const slow = [true, false, false, false, true];
  expect(believed(slow, 1000)).toEqual([true, true, true, false, true]);
  const quick = [true, ...Array<boolean>(60).fill(false), true];
  expect(believed(quick, 30).filter(Boolean)).toHaveLength(1 + 50 + 1); // for 1.5 s
});
