/** Bodies for the tests: the default tree, seeded poses. */

import { readFileSync } from "node:fs";
import { POSE, type PoseFrame } from "../src/protocol";
import type { Skeleton } from "../src/skeleton";

interface Row {
  readonly name: string;
  readonly parent: string | null;
  readonly offset: readonly [number, number, number];
}

const body = JSON.parse(
  readFileSync(new URL("../../src/bodysense/body/default_body.json", import.meta.url), "utf8"),
) as { joints: Row[]; end_sites: Row[] };
const rows = [...body.joints, ...body.end_sites];
const names = rows.map(({ name }) => name);

export const skeleton: Skeleton = {
  joints: body.joints.length,
  points: names,
  parents: rows.map(({ parent }) => (parent === null ? -1 : names.indexOf(parent))),
  restOffset: Float32Array.from(rows.flatMap(({ offset }) => offset)),
};

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

/** A pose with every joint turned by up to about `most` rad. */
export function pose(sequence: number, time: number, most = 1): PoseFrame {
  const next = numbers(sequence + 1);
  const rotation = new Float32Array(4 * skeleton.joints);
  for (let joint = 0; joint < skeleton.joints; joint++) {
    const turn = [1, (most / 2) * next(), (most / 2) * next(), (most / 2) * next()];
    rotation.set(
      turn.map((value) => value / Math.hypot(...turn)),
      4 * joint,
    );
  }
  return {
    kind: POSE,
    sequence,
    time,
    rootPosition: Float32Array.from([next(), 1 + 0.1 * next(), next()]),
    rotation,
    expectedError: new Float32Array(skeleton.points.length).fill(0.02),
    hidden: new Uint8Array(skeleton.points.length),
    contact: new Uint8Array(4),
    microseconds: 800,
  };
}
