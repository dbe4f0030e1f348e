/** The live body: observations go to the worker, completed bodies go to the history. */

import type { Observation, Point } from "./body/observation";
import { place, withOffsets, type Body, type Skeleton } from "./body/skeleton";
import type { Engine, Step } from "./engine/engine";
import { History, type BodyFrame, type Moment } from "./takes/history";
import { reasonOf } from "./notice";
import type { Worn } from "./wearer/trackers";
import type { Person } from "./wearer/wearer";

const MOST_WAITING = 2; // frames in the worker: further frames are dropped, not queued
const COUNTED = 600; // steps whose times are kept

export class Live {
  readonly times: number[] = []; // ms, of the last steps
  holdFeet = true; // hold standing feet in place
  hidden: ReadonlySet<string> = new Set(); // points that are ignored
  worn: Worn = {}; // trackers that are worn elsewhere than their names say
  isReady = false; // the network is loaded
  private isPreview = false; // the timeline holds the source's own motion, not completed
  private restOffset: Float32Array | null = null; // of the newest body
  private take = 0; // number of the source: results of an earlier source are dropped

  constructor(
    private readonly engine: Engine,
    readonly skeleton: Skeleton,
    private readonly failed: (reason: string) => void,
    private readonly completed: (time: number, body: Body) => void = () => undefined,
    readonly history = new History(),
  ) {
    void engine.opened.then(
      () => {
        this.isReady = true;
        if (this.isPreview) this.history.clear();
      },
      () => undefined, // the page reports it
    );
  }

  /** The skeleton with the proportions of the newest body. */
  get tree(): Skeleton {
    return withOffsets(this.skeleton, this.restOffset ?? this.skeleton.restOffset);
  }

  /** Begin another source, perhaps of another wearer, with an empty timeline. */
  begin(person: Person): void {
    this.take += 1;
    this.restOffset = null;
    this.hidden = new Set();
    this.worn = {};
    this.history.clear();
    this.isPreview = false;
    this.engine.send({ type: "start", person, holdFeet: this.holdFeet });
  }

  /** Change the known measurements of the wearer; the timeline continues. */
  setPerson(person: Person): void {
    this.engine.send({ type: "person", person });
  }

  hold(holdFeet: boolean): void {
    this.holdFeet = holdFeet;
    this.engine.send({ type: "holdFeet", holdFeet });
  }

  /** Complete an observation; `truth`: the true body if known. Returns false if the worker is busy. */
  track(observation: Observation, truth: Body | null): boolean {
    if (!this.isReady) {
      if (truth) this.preview(observation, truth);
      return true;
    }
    if (this.engine.backlog >= MOST_WAITING) return false;
    const take = this.take;
    const points = observation.points
      .filter(({ name }) => !this.hidden.has(name) && this.worn[name] !== "")
      .map((point) => ({ ...point, name: this.worn[point.name] ?? point.name }));
    const seen = { ...observation, points };
    void this.engine.step(seen).then(
      (step) => take === this.take && this.keep(step, seen, truth),
      (error: unknown) => take === this.take && this.failed(reasonOf(error)),
    );
    return true;
  }

  /** Show frames that were completed before. If the timeline cannot hold all, use every second, third, … */
  replay(frames: readonly BodyFrame[]): void {
    const step = Math.ceil(frames.length / this.history.limit);
    for (const frame of frames.filter((_, k) => k % step === 0)) {
      const { rootPosition, rotation, restOffset } = frame;
      this.history.add(momentOf(frame, place(withOffsets(this.skeleton, restOffset), rootPosition, rotation), []));
    }
  }

  /** Quantile of the steps' durations, ms; `share` from 0 to 1. */
  quantile(share: number): number {
    const sorted = [...this.times].sort((a, b) => a - b);
    return sorted[Math.floor(share * (sorted.length - 1))] ?? 0;
  }

  /** Show the motion itself until the network is loaded. */
  private preview({ time, points }: Observation, truth: Body): void {
    this.isPreview = true;
    const rotation = new Float32Array(4 * this.skeleton.joints);
    const frame = { time, rootPosition: truth.position.slice(0, 3), rotation, restOffset: this.skeleton.restOffset };
    this.history.add(momentOf(frame, truth, points));
  }

  private keep({ completed, milliseconds }: Step, { points }: Observation, truth: Body | null): void {
    const { time, ...body } = completed;
    this.restOffset = body.restOffset;
    this.completed(time, body.body);
    this.times.push(milliseconds);
    if (this.times.length > COUNTED) this.times.shift();
    this.history.add({ ...body, sourceTime: time, signal: points, truth, milliseconds });
  }
}

/** A moment that displays a frame unchanged. */
function momentOf(frame: BodyFrame, body: Body, signal: readonly Point[]): Omit<Moment, "time" | "isJump"> {
  const { time, ...pose } = frame;
  return { ...pose, sourceTime: time, body, signal, truth: null, expected: null, measured: null, milliseconds: 0 };
}
