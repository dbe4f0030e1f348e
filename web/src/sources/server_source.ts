/** A bodysense server whose completed bodies are displayed here. */

import { axisAngle } from "../body/math";
import type { Point } from "../body/observation";
import { place, withOffsets, type Body, type Skeleton } from "../body/skeleton";
import type { History } from "../takes/history";
import type { Calibrate, Recentre, Resume, Settings, Source as Input, Welcome } from "../server/protocol";
import { Connection, socketAddress } from "../server/connection";
import type { PoseFrame, SignalFrame } from "../server/frames";
import type { Worn } from "../wearer/trackers";
import { UNMOVED, applyPlacement, type Placement } from "./placement";

/** One of the server's own inputs, or the session of another client; null: the first of the inputs. */
export type Watched = { readonly watch: Input } | { readonly follow: Resume } | null;

export interface ServerEvents {
  /** The connection is open again. */
  connected?(): void;
  /** The first body of this input arrived. */
  came(): void;
  /** The server has no input of its own. */
  empty?(): void;
  /** The server sent a line for the user to read. */
  notified?(text: string): void;
  /** The server has more inputs than the one that is watched. */
  others?(inputs: readonly Input[]): void;
  /** The connection is lost; `again`: only the user can retry. */
  lost(reason: string, again: boolean): void;
}

const WATCHING = "The server's own input";
const SILENT = 5000; // ms without a body after which an input is silent

/** One wearer of a server, watched. */
export class ServerSource {
  title = WATCHING;
  sensors: readonly string[] = [];
  trackers: readonly string[] = []; // points of the signals so far
  worn: Worn = {};
  private readonly connection: Connection;
  private signal: SignalFrame | null = null; // signal and truth arrive right before their pose
  private truth: PoseFrame | null = null;
  skeleton: Skeleton | null = null;
  private heard: number | null = null; // ms, on the page's clock: arrival of the last body
  private welcome: Welcome | null = null;
  private placement: Placement = UNMOVED;

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
        signal: (frame) => {
          this.signal = frame;
          const names = frame.points.map(({ point }) => this.sensors[point] ?? "");
          if (names.some((name) => !this.trackers.includes(name)))
            this.trackers = [...new Set([...this.trackers, ...names])];
        },
        truth: (frame) => (this.truth = frame),
        pose: (frame) => this.show(frame),
        message: (message) => {
          if (message.type === "placed")
            this.placement = { turn: axisAngle([0, 1, 0], message.heading), offset: message.offset };
          else if (message.type === "proportions" && this.skeleton)
            this.skeleton = withOffsets(this.skeleton, Float32Array.from(message.rest_offset.flat()));
          else if (message.type === "said") this.events.notified?.(message.text);
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

  /** Whether bodies arrived before but no longer do. */
  get isSilent(): boolean {
    return this.heard !== null && performance.now() - this.heard > SILENT;
  }

  stop(): void {
    this.connection.close();
  }

  open(): void {
    this.connection.open();
  }

  /** Change settings of the watched session; no effect on another client's session. */
  updateSettings(change: Partial<Settings>): void {
    if (this.watched && "follow" in this.watched) return;
    this.connection.send({ type: "settings", ...change });
  }

  /** Send a request to the watched session. Returns false for another client's session. */
  ask(message: Recentre | Calibrate): boolean {
    if (this.watched && "follow" in this.watched) return false;
    this.connection.send(message);
    return true;
  }

  private begin(message: Welcome): void {
    const [offered, ...others] = message.sources;
    if (this.watched === null && offered !== undefined) {
      this.watched = { watch: offered };
      this.events.others?.(others);
      this.connection.open(); // say hello again, now naming an input
      return;
    }
    this.welcome = message;
    this.sensors = message.signal;
    this.worn = Object.fromEntries(message.settings.worn.map(({ tracker, joint }) => [tracker, joint]));
    const { joints, points, parents, rest_offset } = message;
    this.skeleton = { joints: joints.length, points, parents, restOffset: Float32Array.from(rest_offset.flat()) };
    this.title = this.watched && "follow" in this.watched ? "Another wearer" : WATCHING;
    this.events.connected?.();
    if (this.watched === null) this.events.empty?.();
  }

  private show(pose: PoseFrame): void {
    const { skeleton, signal, truth } = this;
    if (!skeleton) return;
    const bodyOf = ({ rootPosition, rotation }: PoseFrame): Body => place(skeleton, rootPosition, rotation);
    if (this.heard === null) this.events.came();
    this.heard = performance.now();
    this.history.add({
      sourceTime: pose.time,
      rootPosition: pose.rootPosition,
      rotation: pose.rotation,
      restOffset: skeleton.restOffset,
      body: bodyOf(pose),
      signal: signal?.sequence === pose.sequence ? this.pointsOf(signal) : [],
      truth: truth?.sequence === pose.sequence ? bodyOf(truth) : null,
      expected: pose.expectedError,
      measured: pose.hidden && pose.hidden.map((hidden) => (hidden < 128 ? 1 : 0)),
      milliseconds: pose.microseconds / 1000,
    });
  }

  /** The signal's points in the body's world. */
  private pointsOf({ points }: SignalFrame): Point[] {
    const named = points.map(({ point, ...seen }) => ({ ...seen, name: this.sensors[point] ?? "", accuracy: 0 }));
    return applyPlacement(named, this.placement);
  }
}
