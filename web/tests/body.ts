/** Bodies for the tests: the default tree, seeded poses. */

import { readFileSync } from "node:fs";
import { place, skeletonOfRows, type Skeleton, type SkeletonRows } from "../src/body/skeleton";
import type { Moment } from "../src/takes/history";

const body = JSON.parse(
  readFileSync(new URL("../../src/bodysense/body/default_body.json", import.meta.url), "utf8"),
) as SkeletonRows;

export const skeleton: Skeleton = skeletonOfRows(body);

/** Numbers in −1 … 1 that are the same every time (mulberry32). */
export function numbers(seed: number): () => number {
  let state = seed;
  return () => {
    state = (state + 0x6d2b79f5) | 0;
    let t = Math.imul(state ^ (state >>> 15), 1 | state);
    t = (t + Math.imul(t ^ (t >>> 7), 61 | t)) ^ t;
    return 2 * (((t ^ (t >>> 14)) >>> 0) / 2 ** 32) - 1;
  };
}

/** A moment with every joint turned by up to about `most` rad; its root's x tells its number. */
export function moment(number: number, sourceTime: number, most = 1): Omit<Moment, "time" | "isJump"> {
  const next = numbers(number + 1);
  const rotation = new Float32Array(4 * skeleton.joints);
  for (let joint = 0; joint < skeleton.joints; joint++) {
    const turn = [1, (most / 2) * next(), (most / 2) * next(), (most / 2) * next()];
    rotation.set(
      turn.map((value) => value / Math.hypot(...turn)),
      4 * joint,
    );
  }
  const rootPosition = Float32Array.from([number, 1 + 0.1 * next(), next()]);
  return {
    sourceTime,
    rootPosition,
    rotation,
    restOffset: skeleton.restOffset,
    body: place(skeleton, rootPosition, rotation),
    signal: [],
    truth: null,
    expected: new Float32Array(skeleton.points.length).fill(0.02),
    measured: new Uint8Array(skeleton.points.length),
    milliseconds: 0.8,
  };
}
