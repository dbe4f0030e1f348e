// Compiles against the installed package's types.
import { type Estimate, openModel, type Person } from "@bodysense/core";

const person: Person = {
  height: 1.75,
  lengths: [{ start: "left_hip", end: "left_knee", value: 0.4, deviation: 0.01 }],
};
const model = await openModel(new Uint8Array());
const state = model.start(person, { floor: 0.1 });
const body: Estimate = state.step({ time: 0, points: [{ name: "head", position: [0, 1.6, 0], accuracy: 0.001 }] });
export const x: number | undefined = body.points[0];
// @ts-expect-error: a position has three numbers
state.step({ time: 1, points: [{ name: "head", position: [0, 1.6], accuracy: 0.001 }] });
