/** The tracker: what was tracked in, a whole moving body out (bodysense.tracker). What is not bookkeeping is in the graph. */

import { interval } from "./clock";
import type { Observation } from "./observation";
import { Growing, NOBODY, trackedPoints, type Person } from "./person";
import type { ShapeSpace } from "./shape";
import { worldRotations, type Body, type Skeleton } from "./skeleton";

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

/** One whole body. Its arrays lie in two buffers, which a worker gives away whole: what a take keeps, and the rest. */
export interface Completed {
  readonly time: number; // s
  readonly rootPosition: Float32Array; // (3) m
  readonly rotation: Float32Array; // (joints × 4) wxyz, parent ← joint
  readonly placed: Body;
  readonly restOffset: Float32Array; // (points × 3) m
  readonly measured: Uint8Array; // (points) 0 or 1
  readonly confidence: Float32Array; // (points) m, expected position error
}

function completedAt(time: number, { joints, points }: Skeleton): Completed {
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
    const answer = completedAt(observation.time, this.skeleton);
    answer.restOffset.set(this.body.shown);
    const floats = (data: Float32Array, ...dims: number[]): GraphTensor => ({ type: "float32", data, dims });
    const flags = (data: Uint8Array, ...dims: number[]): GraphTensor => ({ type: "bool", data, dims });
    const outputs = await this.graph.run({
      position: floats(frame.position, points, 3),
      rotation: floats(frame.rotation, joints, 4),
      has_position: flags(frame.hasPosition, points),
      has_rotation: flags(frame.hasRotation, joints),
      accuracy: floats(frame.accuracy, points),
      interval: floats(Float32Array.of(seconds)),
      rest_offset: floats(answer.restOffset, points, 3),
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
    answer.rootPosition.set(read("root_position"));
    answer.rotation.set(read("local_rotation"));
    answer.placed.position.set(read("points"));
    worldRotations(this.skeleton, answer.rotation, answer.placed.rotation);
    answer.measured.set(frame.hasPosition);
    answer.confidence.set(read("confidence"));
    return answer;
  }
}
