// Written by scripts/make_protocol_types.py from bodysense_live; see docs/protocol.md. Do not edit.

export const VERSION = 1;
export const SIGNAL = 1;
export const POSE = 2;
export const TRUTH = 3;
export const HAS_POSITION = 1;
export const HAS_ROTATION = 2;
export const SIGNAL_HEAD_BYTES = 16;
export const POINT_BYTES = 32;
export const ACCURACY_UNIT = 0.0001;
export const POSE_HEAD_BYTES = 16;
export const CONTACTS = 4;

export const SUBPROTOCOL = "bodysense.1";

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
