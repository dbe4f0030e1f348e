/** The tracker: what was tracked in, a whole moving body out (bodysense.tracker). What is not bookkeeping is in the graph. */

import { interval } from "./clock";
import type { Observation } from "./observation";
import { Growing, NOBODY, trackedPoints, type Person } from "./person";
import type { ShapeSpace } from "./shape";
import type { Skeleton } from "./skeleton";

export interface GraphTensor {
  readonly type: "float32" | "bool" | "int64";
  readonly data: Float32Array | Uint8Array | BigInt64Array;
  readonly dims: readonly number[]; // without the batch, which is one
}

export type Tensors = Readonly<Record<string, GraphTensor>>;

/** The network's graph: one step, its state through inputs `state_…` and outputs `next_…`. */
export interface Graph {
  readonly start: Tensors; // by input
  run(inputs: Tensors): Promise<Tensors>;
}

/** One whole body. */
export interface Completed {
  readonly time: number; // s
  readonly rootPosition: Float32Array; // (3) m
  readonly rotation: Float32Array; // (joints × 4) wxyz, parent ← joint
  readonly points: Float32Array; // (points × 3) m, world
  readonly restOffset: Float32Array; // (points × 3) m
  readonly measured: Uint8Array; // (points) 0 or 1
  readonly confidence: Float32Array; // (points) m, expected position error
  readonly contact: Float32Array; // (4) probability
}

export interface TrackerSettings {
  readonly floor: number; // m
  readonly holdFeet: boolean;
}

export const TRACKER_SETTINGS: TrackerSettings = { floor: 0, holdFeet: true };

export class Tracker {
  settings = TRACKER_SETTINGS;
  private time = Number.NaN;
  private state: Tensors;
  private body: Growing;

  constructor(
    private readonly graph: Graph,
    private readonly space: ShapeSpace,
    private readonly skeleton: Skeleton,
    person: Person = NOBODY,
  ) {
    this.state = graph.start;
    this.body = new Growing(space, skeleton, person);
  }

  /** Begin anew, with a wearer of whom only this is known. */
  start(person: Person): void {
    this.time = Number.NaN;
    this.state = this.graph.start;
    this.body = new Growing(this.space, this.skeleton, person);
  }

  /** More is known of the same wearer. */
  tell(person: Person): void {
    this.body.tell(person);
  }

  async step(observation: Observation): Promise<Completed> {
    const { seconds, isFresh } = interval(observation.time, this.time);
    const frame = trackedPoints(observation, this.skeleton);
    const [points, joints] = [this.skeleton.points.length, this.skeleton.joints];
    if (isFresh) this.state = this.graph.start;
    this.time = observation.time;
    this.body.update(frame, seconds, this.settings.floor);
    const restOffset = Float32Array.from(this.body.shown);
    const floats = (data: Float32Array, ...dims: number[]): GraphTensor => ({ type: "float32", data, dims });
    const flags = (data: Uint8Array, ...dims: number[]): GraphTensor => ({ type: "bool", data, dims });
    const outputs = await this.graph.run({
      position: floats(frame.position, points, 3),
      rotation: floats(frame.rotation, joints, 4),
      has_position: flags(frame.hasPosition, points),
      has_rotation: flags(frame.hasRotation, joints),
      accuracy: floats(frame.accuracy, points),
      interval: floats(Float32Array.of(seconds)),
      rest_offset: floats(restOffset, points, 3),
      certainty: floats(Float32Array.from(this.body.deviation), points),
      floor: floats(Float32Array.of(this.settings.floor)),
      hold: floats(Float32Array.of(this.settings.holdFeet ? 1 : 0)),
      ...this.state,
    });
    const read = (name: string): Float32Array => outputs[name].data as Float32Array;
    this.state = Object.fromEntries(
      Object.entries(this.graph.start).map(([name, { type, dims }]) => [
        name,
        { type, dims, data: outputs[name.replace("state_", "next_")].data },
      ]),
    );
    return {
      time: observation.time,
      rootPosition: read("root_position"),
      rotation: read("local_rotation"),
      points: read("points"),
      restOffset,
      measured: frame.hasPosition,
      confidence: read("confidence"),
      contact: read("contact"),
    };
  }
}
