/** A server of bodysense: what it tracks is watched here, completed by it. */

import type { Quaternion, Vector } from "../body/math";
import type { Point } from "../body/observation";
import { place, type Body, type Skeleton } from "../body/skeleton";
import type { History } from "../history";
import type {
  Calibrate,
  PoseFrame,
  Recentre,
  Resume,
  Settings,
  SignalFrame,
  SignalPoint,
  Source as Input,
  Welcome,
} from "../protocol";
import { Connection, socketAddress } from "../server/connection";
import type { Source } from "./source";

/** One of the server's own inputs, or the session of another client; null: the first of the inputs. */
export type Watched = { readonly watch: Input } | { readonly follow: Resume } | null;

export interface ServerEvents {
  /** The skeleton of the server's body. */
  skeleton(skeleton: Skeleton): void;
  /** The connection is there again. */
  connected(): void;
  /** The first body of this input is there. */
  came(): void;
  /** The server has no input of its own. */
  empty(): void;
  said(text: string): void;
  /** The server has more inputs than the one that is watched. */
  others(inputs: readonly Input[]): void;
  /** `again` where the page waits for the person. */
  lost(reason: string, again: boolean): void;
}

const WATCHING = "The server's own input";
const SILENT = 5000; // ms without a body after which an input is silent
const WAITING = 64; // signals and truths that wait for their pose

/** One wearer of a server, watched. */
export class ServerSource implements Source {
  title = WATCHING;
  sensors: readonly string[] = [];
  private readonly connection: Connection;
  private readonly signals = new Map<number, SignalFrame>();
  private readonly truths = new Map<number, Body>();
  private skeleton: Skeleton | null = null;
  private heard: number | null = null; // ms, of the page's clock: the last body
  private welcome: Welcome | null = null;
  private placement = { offset: [0, 0, 0] as readonly number[], heading: 0 };

  constructor(
    address: string,
    private readonly history: History,
    private watched: Watched,
    private readonly events: ServerEvents,
  ) {
    this.connection = new Connection(
      socketAddress({ href: address }),
      () => ({
        name: "page",
        points: [],
        watch: null,
        follow: null,
        ...this.watched,
        resume: this.welcome?.token ? { session: this.welcome.session, token: this.welcome.token } : null,
      }),
      {
        welcome: (message) => this.begin(message),
        signal: (frame) => remember(this.signals, frame.sequence, frame),
        truth: (frame) =>
          this.skeleton &&
          remember(this.truths, frame.sequence, place(this.skeleton, frame.rootPosition, frame.rotation)),
        pose: (frame) => this.show(frame),
        message: (message) => {
          if (message.type === "placed") this.placement = message;
          else if (message.type === "proportions") this.grow(message.rest_offset);
          else if (message.type === "said") this.events.said(message.text);
          else if (message.type === "error") this.events.lost(message.reason, true);
        },
        lost: (reason, retryIn) => {
          this.title = "The server does not answer";
          this.events.lost(reason, retryIn === null);
        },
      },
    );
    this.connection.open();
  }

  frame(): void {
    // The server sends when it has something.
  }

  /** Whether bodies came, and come no more. */
  get isSilent(): boolean {
    return this.heard !== null && performance.now() - this.heard > SILENT;
  }

  stop(): void {
    this.connection.close();
  }

  open(): void {
    this.connection.open();
  }

  /** Change settings of the session that is watched; another client's are its own. */
  tell(change: Partial<Settings>): void {
    if (this.watched && "follow" in this.watched) return;
    this.connection.tell({ type: "settings", ...change });
  }

  /** Ask something of the session that is watched; false if it is another client's. */
  ask(message: Recentre | Calibrate): boolean {
    if (this.watched && "follow" in this.watched) return false;
    this.connection.tell(message);
    return true;
  }

  private begin(message: Welcome): void {
    const [offered, ...others] = message.sources;
    if (this.watched === null && offered !== undefined) {
      this.watched = { watch: offered };
      this.events.others(others);
      this.connection.open(); // hello again, with what there is to be watched
      return;
    }
    this.welcome = message;
    this.sensors = message.signal;
    const { joints, points, parents, rest_offset } = message;
    this.skeleton = { joints: joints.length, points, parents, restOffset: Float32Array.from(rest_offset.flat()) };
    this.events.skeleton(this.skeleton);
    this.title = this.watched && "follow" in this.watched ? "Another wearer" : WATCHING;
    this.events.connected();
    if (this.watched === null) this.events.empty();
  }

  private grow(offset: Welcome["rest_offset"]): void {
    if (!this.skeleton) return;
    this.skeleton = { ...this.skeleton, restOffset: Float32Array.from(offset.flat()) };
  }

  private show(pose: PoseFrame): void {
    if (!this.skeleton) return;
    if (this.heard === null) this.events.came();
    this.heard = performance.now();
    this.history.add({
      sourceTime: pose.time,
      rootPosition: pose.rootPosition,
      rotation: pose.rotation,
      restOffset: this.skeleton.restOffset,
      body: place(this.skeleton, pose.rootPosition, pose.rotation),
      signal: this.points(this.signals.get(pose.sequence)?.points ?? []),
      truth: this.truths.get(pose.sequence) ?? null,
      expected: pose.expectedError,
      measured: pose.hidden && pose.hidden.map((hidden) => (hidden < 128 ? 1 : 0)),
      milliseconds: pose.microseconds / 1000,
    });
  }

  /** The signal's points in the body's world. */
  private points(signal: readonly SignalPoint[]): Point[] {
    const { offset, heading } = this.placement;
    const [sine, cosine] = [Math.sin(heading), Math.cos(heading)];
    return signal.map(({ point, position, rotation }) => ({
      name: this.sensors[point] ?? "",
      accuracy: 0,
      rotation: rotation as Quaternion | null,
      position:
        position &&
        ([
          cosine * position[0] + sine * position[2] + offset[0],
          position[1] + offset[1],
          cosine * position[2] - sine * position[0] + offset[2],
        ] as Vector),
    }));
  }
}

function remember<T>(map: Map<number, T>, key: number, value: T): void {
  map.set(key, value);
  const oldest = map.keys().next();
  if (map.size > WAITING && !oldest.done) map.delete(oldest.value);
}
