/** The tracker: what was tracked in, a whole moving body out (bodysense.tracker). What is not bookkeeping is in the graph. */

import { interval } from "./clock";
import type { Observation } from "./observation";
import { fillPoints, Growing, NOBODY, type Person, type TrackedPoints } from "./person";
import type { ShapeSpace } from "./shape";
import { worldRotations, type Body, type Skeleton } from "./skeleton";

/** What the graph reads of a frame. */
export interface Inputs extends TrackedPoints {
  readonly interval: Float32Array; // (1) s
  readonly restOffset: Float32Array; // (points × 3) m
  readonly certainty: Float32Array; // (points) m, standard deviation of each bone's length
  readonly floor: Float32Array; // (1) m
  readonly hold: Float32Array; // (1) whether feet are held, 0 or 1
}

export interface Outputs {
  readonly rootPosition: Float32Array; // (3) m
  readonly localRotation: Float32Array; // (joints × 4) wxyz, parent ← joint
  readonly points: Float32Array; // (points × 3) m
  readonly confidence: Float32Array; // (points) m
}

/** The network's graph: one step of one person, whose state it remembers. */
export interface Graph {
  readonly inputs: Inputs; // filled anew before each run
  /** Forget what was before. */
  start(): void;
  run(): Promise<Outputs>;
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
  private body: Growing;

  constructor(
    private readonly graph: Graph,
    private readonly space: ShapeSpace,
    private readonly skeleton: Skeleton,
    person: Person = NOBODY,
  ) {
    graph.start();
    this.body = new Growing(space, skeleton, person);
  }

  /** Begin anew, with a wearer of whom only this is known. */
  start(person: Person): void {
    this.time = Number.NaN;
    this.graph.start();
    this.body = new Growing(this.space, this.skeleton, person);
  }

  /** More is known of the same wearer. */
  tell(person: Person): void {
    this.body.tell(person);
  }

  async step(observation: Observation): Promise<Completed> {
    const { seconds, isFresh } = interval(observation.time, this.time);
    const { graph, body, settings } = this;
    const { inputs } = graph;
    if (isFresh) graph.start();
    this.time = observation.time;
    fillPoints(inputs, observation, this.skeleton);
    body.update(inputs, seconds, settings.floor);
    inputs.interval[0] = seconds;
    inputs.restOffset.set(body.shown);
    inputs.certainty.set(body.deviation);
    inputs.floor[0] = settings.floor;
    inputs.hold[0] = settings.holdFeet ? 1 : 0;
    const answer = completedAt(observation.time, this.skeleton);
    answer.restOffset.set(inputs.restOffset);
    answer.measured.set(inputs.hasPosition);
    const outputs = await graph.run();
    answer.rootPosition.set(outputs.rootPosition);
    answer.rotation.set(outputs.localRotation);
    answer.placed.position.set(outputs.points);
    worldRotations(this.skeleton, answer.rotation, answer.placed.rotation);
    answer.confidence.set(outputs.confidence);
    return answer;
  }
}
