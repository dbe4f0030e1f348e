import { expect, it } from "vitest";
import { followed } from "../../src/view/scene";

/** How far the camera is behind a person who walked for four seconds at 1.2 m/s. */
function behind(picturesPerSecond: number): number {
  const [seconds, speed] = [1 / picturesPerSecond, 1.2];
  let camera = 0;
  for (let k = 1; k <= 4 * picturesPerSecond; k++) camera += followed(k * seconds * speed - camera, seconds);
  return 4 * speed - camera;
}

it("follows a body that walks as closely where few pictures are drawn", () => {
  expect(behind(60)).toBeCloseTo(0.29, 2);
  expect(behind(2)).toBeLessThan(0.5);
  expect(followed(1, 30)).toBeCloseTo(1); // after a pause of the page it is there
  expect(followed(1, -1)).toBe(0);
});
