import { expect, it } from "vitest";
import { FirstPicture } from "../src/first";
import type { Moment } from "../src/history";

it("says once that pictures move: two of different moments were drawn", () => {
  const [a, b, c] = [{}, {}, {}] as Moment[];
  let told = 0;
  const first = new FirstPicture(() => (told += 1));
  const after = [a, a, b, b, c, a, b].map((moment) => {
    first.draw(moment);
    return told;
  });
  expect(after).toEqual([0, 0, 0, 1, 1, 1, 1]);
  expect(performance.getEntriesByName("moving")).toHaveLength(1);
});

it("marks once that a completed body was drawn", () => {
  performance.clearMarks();
  const [truth, completed] = [{ expected: null }, { expected: new Float32Array(1) }] as Moment[];
  const first = new FirstPicture(() => undefined);
  const marks = [truth, truth, completed, completed, completed].map((moment) => {
    first.draw(moment);
    return performance.getEntriesByName("completed").length;
  });
  expect(marks).toEqual([0, 0, 0, 1, 1]);
});
