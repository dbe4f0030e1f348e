/** A wearer's bodies by the core, in the arrays that the page draws and keeps. */

import type { Model, Person as Known, Settings, State } from "@bodysense/core";
import type { Observation } from "../body/observation";
import { restPoint, worldRotations, type Body, type Skeleton } from "../body/skeleton";
import { DEVIATION, NOBODY, type Person } from "../wearer";

/** One whole body. Its arrays are in two buffers, which a worker gives away whole: what a take keeps, and the rest. */
export interface Completed {
  readonly time: number; // s
  readonly rootPosition: Float32Array; // (3) m
  readonly rotation: Float32Array; // (joints × 4) wxyz, parent ← joint
  readonly placed: Body;
  readonly restOffset: Float32Array; // (points × 3) m
  readonly measured: Uint8Array; // (points) 0 or 1
  readonly confidence: Float32Array; // (points) m, expected position error
}

export type TrackerSettings = Pick<Settings, "floor" | "holdFeet">;

export const TRACKER_SETTINGS: TrackerSettings = { floor: 0, holdFeet: true };

export class Tracker {
  settings = TRACKER_SETTINGS;
  private readonly names: ReadonlySet<string>;
  private readonly ratio: number; // of a mean adult's stature to the height of their head joint
  private state: State;

  constructor(
    private readonly model: Model,
    private readonly skeleton: Skeleton,
  ) {
    this.names = new Set(model.points);
    this.state = model.start();
    const adult = { ...skeleton, restOffset: Float32Array.from(this.state.person().restOffset ?? []) };
    this.ratio = restPoint(adult, "head_top")[1] / restPoint(adult, "head")[1];
  }

  /** Reset, with a wearer whose known measurements are `person`. */
  start(person: Person = NOBODY): void {
    const state = this.model.start(this.known(person));
    this.state.close();
    this.state = state;
  }

  /** More is known of the same wearer. */
  tell(person: Person): void {
    this.state.update(this.known(person));
  }

  /** Complete the next frame. Points that the body does not have are left out. */
  step({ time, points }: Observation): Completed {
    const seen = points.filter(({ name }) => this.names.has(name));
    const estimate = this.state.step({ time, points: seen }, this.settings);
    const body = emptyBody(time, this.skeleton);
    body.rootPosition.set(estimate.rootPosition);
    body.rotation.set(estimate.rotation);
    body.placed.position.set(estimate.points);
    worldRotations(this.skeleton, body.rotation, body.placed.rotation);
    body.restOffset.set(estimate.restOffset);
    body.confidence.set(estimate.confidence);
    body.measured.set(estimate.measured);
    return body;
  }

  private known({ head, ...person }: Person): Known {
    if (head === undefined) return person;
    return { ...person, height: head * this.ratio, heightDeviation: DEVIATION * this.ratio };
  }
}

function emptyBody(time: number, { joints, points }: Skeleton): Completed {
  const count = points.length;
  const motion = new Float32Array(3 + 4 * joints);
  const rest = new Float32Array(7 * count + 4 * joints + Math.ceil(count / 4));
  const turned = 3 * count + 4 * joints;
  return {
    time,
    rootPosition: motion.subarray(0, 3),
    rotation: motion.subarray(3),
    placed: { position: rest.subarray(0, 3 * count), rotation: rest.subarray(3 * count, turned) },
    restOffset: rest.subarray(turned, turned + 3 * count),
    confidence: rest.subarray(turned + 3 * count, turned + 4 * count),
    measured: new Uint8Array(rest.buffer, 4 * (turned + 4 * count), count),
  };
}
