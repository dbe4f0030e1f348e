/** A wearer's bodies by the core, in the arrays that the page draws and keeps. */

import type { Model, Person as Known, State } from "@bodysense/core";
import type { Observation } from "../body/observation";
import { restPoint, worldRotations, type Body, type Skeleton } from "../body/skeleton";
import type { BodyFrame } from "../takes/history";
import { DEVIATION, NOBODY, type Person } from "../wearer/wearer";

/** One whole body. */
export interface Completed extends BodyFrame {
  readonly body: Body;
  readonly expected: Float32Array; // (points) m, expected position error
  readonly measured: Uint8Array; // (points) 0 or 1
}

export class Tracker {
  holdFeet = true; // standing feet stay where they are
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
  setPerson(person: Person): void {
    this.state.update(this.known(person));
  }

  /** Complete the next frame. Points that the body does not have are left out. */
  step({ time, points }: Observation): Completed {
    const seen = points.filter(({ name }) => this.names.has(name));
    const estimate = this.state.step({ time, points: seen }, { holdFeet: this.holdFeet });
    const rotation = new Float32Array(estimate.rotation);
    return {
      time,
      rootPosition: new Float32Array(estimate.rootPosition),
      rotation,
      restOffset: new Float32Array(estimate.restOffset),
      body: { position: new Float32Array(estimate.points), rotation: worldRotations(this.skeleton, rotation) },
      expected: new Float32Array(estimate.confidence),
      measured: estimate.measured,
    };
  }

  private known({ head, ...person }: Person): Known {
    if (head === undefined) return person;
    return { ...person, height: head * this.ratio, heightDeviation: DEVIATION * this.ratio };
  }
}
