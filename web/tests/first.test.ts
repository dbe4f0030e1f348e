import { expect, it } from "vitest";
import { FirstPicture } from "../src/first";
import type { Moment } from "../src/takes/history";

it("marks once that pictures move: two of different moments were drawn", () => {
  const [a, b, c] = [{}, {}, {}] as Moment[];
  const first = new FirstPicture(() => undefined);
  const after = [a, a, b, b, c, a, b].map((moment) => {
    first.draw(moment);
    return performance.getEntriesByName("moving").length;
  });
  expect(after).toEqual([0, 0, 0, 1, 1, 1, 1]);
});

it("marks and says once that a completed body was drawn", () => {
  performance.clearMarks();
  const [truth, completed] = [{ expected: null }, { expected: new Float32Array(1) }] as Moment[];
  let calls = 0;
  const first = new FirstPicture(() => (calls += 1));
  const marks = [truth, truth, completed, completed, completed].map((moment) => {
    first.draw(moment);
    return [performance.getEntriesByName("completed").length, calls];
  });
  expect(marks).toEqual([0, 0, 0, 1, 1].map((count) => [count, count]));
});

it("says so only when pictures move, however soon the network is there", () => {
  performance.clearMarks();
  const [a, b] = [{ expected: new Float32Array(1) }, { expected: new Float32Array(1) }] as Moment[];
  let calls = 0;
  const first = new FirstPicture(() => (calls += 1));
  const after = [a, a, a, b, b].map((moment) => {
    first.draw(moment);
    return calls;
  });
  expect(after).toEqual([0, 0, 0, 0, 1]);
});
