// Written by scripts/make_protocol_types.py from bodysense_live; see docs/protocol.md. Do not edit.

export const VERSION = 1;
export const SIGNAL = 1;
export const POSE = 2;
export const TRUTH = 3;
export const HAS_POSITION = 1;
export const HAS_ROTATION = 2;
export const MOST_POINTS = 128;
export const SIGNAL_HEAD_BYTES = 16;
export const POINT_BYTES = 32;
export const ACCURACY_UNIT = 0.0001;
export const POSE_HEAD_BYTES = 16;
export const CONTACTS = 4;

export const SUBPROTOCOL = "bodysense.1";
export const REGIONS = ["torso", "head", "arms", "fingers", "legs"] as const;

export type Region = "torso" | "head" | "arms" | "fingers" | "legs";

export type Posture = "standing" | "seated";

export type Source = "replay" | "vmc" | "markers" | "vmt" | "vrchat" | "slimevr" | "solarxr";

/** How one person is set up; a client may change each at any time, and keeps them. */
export interface Settings {
  /** Height of the wearer, m; inferred, with the other proportions, if null. */
  height: number | null;
  /** A seated wearer is displayed standing: the signal is raised until the head is at its standing height. */
  posture: Posture;
  /** Left and right are swapped in the answer, as in a mirror. */
  mirror: boolean;
  /** Regions that are driven; the others stay as in standing. */
  regions: Region[];
  /** Half-life in s of a smoother after everything else, 0 to 0.5; as much later is the answer. */
  smoothing: number;
  /** Points of the signal to ignore. */
  hidden: string[];
  /** m, of the floor over y = 0. */
  floor: number;
  /** Standing feet are held in place, and kept above the floor. */
  hold_feet: boolean;
}

/** The session that a client had before its connection broke. */
export interface Resume {
  session: string;
  token: string;
}

/** The first message of a client. */
export interface Hello {
  type: "hello";
  version: number;
  /** Names of the points of its signal, at most 128. */
  points?: string[];
  /** Short for `settings.height`. */
  height?: number | null;
  name?: string;
  settings?: Partial<Settings>;
  resume?: Resume | null;
  /** The server's own input to be shown, instead of a signal of the client. */
  watch?: Source | null;
  /** Another client's session to be shown, with its `watch_token`. */
  follow?: Resume | null;
}

/** `settings`: the settings to be changed; those that are not named stay. */
export type Change = { type: "settings" } & Partial<Settings>;

/** Use the wearer's position and heading now as the origin, facing +Z. */
export interface Recentre {
  type: "recentre";
}

/** Begin or end a recording on the server's disk, which must allow it. */
export interface RecordSwitch {
  type: "record";
  on: boolean;
}

/** The wearer stands upright for one second from now: height and how trackers are worn are taken from it. */
export interface Calibrate {
  type: "calibrate";
  /** To the sides: then the reach of the arms is taken as well. */
  arms_out?: boolean;
}

/** Answered by a pong with the same time. */
export interface Ping {
  type: "ping";
  time: number;
}

/** Drive a replay that is watched: what is null stays. */
export interface Replay {
  type: "replay";
  playing?: boolean | null;
  /** s from its beginning. */
  time?: number | null;
  /** 0.1 to 4 times as fast. */
  speed?: number | null;
}

/** The answer to a hello, and to a change of the settings. */
export interface Welcome {
  type: "welcome";
  session: string;
  /** With which the session can be resumed. */
  token: string;
  /** With which others can watch it. */
  watch_token: string;
  name: string;
  joints: string[];
  /** The joints, then the end sites. */
  points: string[];
  /** Index of every point's parent joint, -1 for the root. */
  parents: number[];
  /** m, of every point from its parent in the T-pose. */
  rest_offset: ([number, number, number])[];
  /** m, from the floor to the crown, of this body. */
  height: number;
  /** Names of the points of the signal. */
  signal: string[];
  settings: Settings;
  /** The server's own inputs, for `watch`. */
  sources: Source[];
  /** Whether the server records on its disk where it is asked to. */
  recording: boolean;
  /** s, of a replay that is watched. */
  length: number | null;
  resumed: boolean;
  version: number;
}

/** The body has other proportions from the next pose on: they were inferred, or set. */
export interface ProportionsChanged {
  type: "proportions";
  /** m, of every point from its parent in the T-pose. */
  rest_offset: ([number, number, number])[];
  /** m, from the floor to the crown. */
  height: number;
}

/** How the signal's world is moved into the body's: body = Ry(heading) · signal + offset. */
export interface Placed {
  type: "placed";
  /** m. */
  offset: [number, number, number];
  /** rad, about +Y. */
  heading: number;
}

/** A line for the wearer to read. */
export interface Notice {
  type: "said";
  text: string;
}

/** Why the server closes the connection. */
export interface Refused {
  type: "error";
  reason: string;
}

/** The answer to a ping. */
export interface Pong {
  type: "pong";
  time: number;
}

export type ClientMessage = Hello | Change | Recentre | RecordSwitch | Calibrate | Ping | Replay;

export type ServerMessage = Welcome | ProportionsChanged | Placed | Notice | Refused | Pong;

/** A point of a signal frame: by its place in the hello, in the signal's own world. Quaternions are w x y z. */
export interface SignalPoint {
  point: number;
  position: readonly [number, number, number] | null;
  rotation: readonly [number, number, number, number] | null;
  /** m, the expected error of the position; left out or 0, the server assumes what is usual for such a point. */
  accuracy?: number;
}

export interface SignalFrame {
  sequence: number;
  /** s, of the client's own clock. */
  time: number;
  points: SignalPoint[];
}

export interface PoseFrame {
  kind: typeof POSE | typeof TRUTH;
  /** That of the signal that it answers. */
  sequence: number;
  /** s, of that signal. */
  time: number;
  /** (3) m, world. */
  rootPosition: Float32Array;
  /** (joints · 4) w x y z, parent ← joint. */
  rotation: Float32Array;
  /** (points) m; null in a truth. */
  expectedError: Float32Array | null;
  /** (points) 0 … 255, the probability that a point was hidden: 255 where it was not measured; null in a truth. */
  hidden: Uint8Array | null;
  /** (4) 0 … 255, the probability that left and right ankle, left and right ball of the foot rest; null in a truth. */
  contact: Uint8Array | null;
  /** Spent in the server. */
  microseconds: number;
}

/** The bytes of a signal frame. */
export function writeSignal(frame: SignalFrame): ArrayBuffer {
  const buffer = new ArrayBuffer(SIGNAL_HEAD_BYTES + frame.points.length * POINT_BYTES);
  const view = new DataView(buffer);
  view.setUint8(0, SIGNAL);
  view.setUint16(2, frame.points.length, true);
  view.setUint32(4, frame.sequence >>> 0, true);
  view.setFloat64(8, frame.time, true);
  frame.points.forEach((point, index) => {
    const at = SIGNAL_HEAD_BYTES + index * POINT_BYTES;
    view.setUint8(at, point.point);
    view.setUint8(at + 1, (point.position ? HAS_POSITION : 0) | (point.rotation ? HAS_ROTATION : 0));
    view.setUint16(at + 2, Math.min(Math.round((point.accuracy ?? 0) / ACCURACY_UNIT), 0xffff), true);
    point.position?.forEach((value, k) => view.setFloat32(at + 4 + 4 * k, value, true));
    point.rotation?.forEach((value, k) => view.setFloat32(at + 16 + 4 * k, value, true));
  });
  return buffer;
}

/** Return the kind of a binary message of the server. */
export function kindOf(buffer: ArrayBuffer): number {
  return new DataView(buffer).getUint8(0);
}

/** A signal that the server played itself (`watch`). */
export function readSignal(buffer: ArrayBuffer): SignalFrame {
  const view = new DataView(buffer);
  const points: SignalPoint[] = [];
  for (let index = 0; index < view.getUint16(2, true); index++) {
    const at = SIGNAL_HEAD_BYTES + index * POINT_BYTES;
    const has = view.getUint8(at + 1);
    const number = (k: number) => view.getFloat32(at + 4 + 4 * k, true);
    points.push({
      point: view.getUint8(at),
      accuracy: view.getUint16(at + 2, true) * ACCURACY_UNIT,
      position: has & HAS_POSITION ? [number(0), number(1), number(2)] : null,
      rotation: has & HAS_ROTATION ? [number(3), number(4), number(5), number(6)] : null,
    });
  }
  return { sequence: view.getUint32(4, true), time: view.getFloat64(8, true), points };
}

/** Read a pose or a truth of a skeleton with `points` points. */
export function readPose(buffer: ArrayBuffer, points: number): PoseFrame {
  const view = new DataView(buffer);
  const kind = view.getUint8(0) as typeof POSE | typeof TRUTH;
  const joints = view.getUint16(2, true);
  const floats = (at: number, count: number) => new Float32Array(buffer.slice(at, at + 4 * count));
  const errors = POSE_HEAD_BYTES + 12 + 16 * joints;
  const hidden = errors + 4 * points;
  const contact = hidden + points;
  return {
    kind,
    sequence: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    rootPosition: floats(POSE_HEAD_BYTES, 3),
    rotation: floats(POSE_HEAD_BYTES + 12, 4 * joints),
    expectedError: kind === POSE ? floats(errors, points) : null,
    hidden: kind === POSE ? new Uint8Array(buffer, hidden, points) : null,
    contact: kind === POSE ? new Uint8Array(buffer, contact, CONTACTS) : null,
    microseconds: kind === POSE ? view.getUint32(contact + CONTACTS, true) : 0,
  };
}
