/** A wearer's bodies by the core, in the arrays that the page draws and keeps. */

import type { Model, Person as Known, Settings, State } from "@bodysense/core";
import type { Observation } from "../body/observation";
import { restPoint, worldRotations, type Body, type Skeleton } from "../body/skeleton";
import type { BodyFrame } from "../history";
import { DEVIATION, NOBODY, type Person } from "../wearer";

/** One whole body. Its arrays are in two buffers, which a worker gives away whole: what a take keeps, and the rest. */
export interface Completed extends BodyFrame {
  readonly body: Body;
  readonly expected: Float32Array; // (points) m, expected position error
  readonly measured: Uint8Array; // (points) 0 or 1
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
    const completed = emptyBody(time, this.skeleton);
    completed.rootPosition.set(estimate.rootPosition);
    completed.rotation.set(estimate.rotation);
    completed.body.position.set(estimate.points);
    worldRotations(this.skeleton, completed.rotation, completed.body.rotation);
    completed.restOffset.set(estimate.restOffset);
    completed.expected.set(estimate.confidence);
    completed.measured.set(estimate.measured);
    return completed;
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
    body: { position: rest.subarray(0, 3 * count), rotation: rest.subarray(3 * count, turned) },
    restOffset: rest.subarray(turned, turned + 3 * count),
    expected: rest.subarray(turned + 3 * count, turned + 4 * count),
    measured: new Uint8Array(rest.buffer, 4 * (turned + 4 * count), count),
  };
}
