/** A recording through the package `@bodysense/core`, as it is installed beside this file. */

import { openModel } from "@bodysense/core";

/** Bodies of a recording's frames, the person believed after them, and times in milliseconds. */
export async function run(recording, weights, wasm) {
  const began = performance.now();
  const model = await openModel(weights, wasm);
  const state = model.start(recording.person, recording.settings);
  const [bodies, spent] = [[], []];
  let first = 0;
  for (const frame of recording.frames) {
    const before = performance.now();
    bodies.push(state.step(frame));
    const after = performance.now();
    spent.push(after - before);
    if (bodies.length === 1) first = after - began;
  }
  const plain = (body) => Object.fromEntries(Object.entries(body).map(([name, values]) => [name, [...values]]));
  const { restOffset, deviation, mounts, height } = state.person();
  const person = { restOffset: [...restOffset], deviation: [...deviation], mounts, height };
  const sorted = spent.sort((a, b) => a - b);
  const quantile = (share) => sorted[Math.floor(share * (sorted.length - 1))];
  const times = { first_body_ms: first, p50_ms: quantile(0.5), p99_ms: quantile(0.99), frames: spent.length };
  return { kernel: model.kernel, points: model.points, bodies: bodies.map(plain), person, times };
}

/** What the package says about everything that it refuses. */
export async function refusals(weights) {
  const model = await openModel(weights);
  const [state, closed] = [model.start(), model.start()];
  closed.close();
  const head = { name: "head", position: [0, 1.6, 0], rotation: [1, 0, 0, 0], accuracy: 0.001 };
  const one = (time, point) => () => state.step({ time, points: [point] });
  const tracker = { translation: [0, 0, 0], rotation: [1, 0, 0, 0] };
  state.step({ time: 1, points: [head] });
  const wrong = {
    damaged: () => openModel(weights.subarray(0, 1000)),
    time: one(1, head),
    unknown: one(2, { ...head, name: "hat" }),
    position: one(2, { ...head, position: [0, NaN, 0] }),
    accuracy: one(2, { ...head, accuracy: undefined }),
    rotation: one(2, { ...head, rotation: [2, 0, 0, 0] }),
    vector: one(2, { ...head, position: [0, 1] }),
    many: () => state.step({ time: 2, points: Array(66).fill(head) }),
    height: () => model.start({ height: 5 }),
    lengths: () => model.start({ lengths: Array(33).fill({ start: "head", end: "neck", value: 1, deviation: 1 }) }),
    mount: () => model.start({ mounts: [{ ...tracker, joint: "left_toe" }] }),
    setting: () => model.start({}, { ease: NaN }).step({ time: 0, points: [] }),
    closed: () => closed.person(),
  };
  const messages = {};
  for (const [name, attempt] of Object.entries(wrong)) {
    try {
      await attempt();
    } catch (error) {
      messages[name] = error.message;
    }
  }
  state.step({ time: 2, points: [head] }); // what was refused changed nothing
  return messages;
}
