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

export type Source = "replay" | "vmc" | "markers" | "vmt" | "vrchat" | "slimevr" | "solarxr" | "camera";

/** Where a strapped tracker is worn. */
export interface Worn {
  /** Its name in the signal. */
  tracker: string;
  /** The joint that carries it; empty: the tracker is ignored. */
  joint: string;
}

/** A known distance between two joints of the wearer in the T-pose. */
export interface KnownLength {
  start: string;
  end: string;
  metres: number;
}

/** Settings of one session. A client may change each at any time. */
export interface Settings {
  /** Height of the wearer in m; null: it is inferred with the other proportions. */
  height: number | null;
  /** A seated wearer is displayed standing: the signal is raised until the head is at its standing height. */
  posture: Posture;
  /** Swap left and right in the answer, as in a mirror. */
  mirror: boolean;
  /** Regions that move; the others keep the standing pose. */
  regions: Region[];
  /** Half-life in s of the smoothing of the whole body, 0 to 0.5; it delays the body by as much. */
  smoothing: number;
  /** Points of the signal to ignore. */
  hidden: string[];
  /** Height of the floor in m, above y = 0. */
  floor: number;
  /** Hold standing feet in place, and keep feet above the floor. */
  hold_feet: boolean;
  /** Known lengths of the wearer; the others are inferred. */
  lengths: KnownLength[];
  /** Where trackers are worn, if not where their names say. Calibration adds the joints that it finds. */
  worn: Worn[];
}

/** A session of an earlier connection. */
export interface Resume {
  session: string;
  token: string;
}

/** The first message of a client. */
export interface Hello {
  type: "hello";
  version: number;
  /** Names of the signal's points, at most 128. */
  points?: string[];
  /** Shorthand for `settings.height`. */
  height?: number | null;
  name?: string;
  settings?: Partial<Settings>;
  resume?: Resume | null;
  /** One of the server's own inputs to watch, in place of a signal from the client. */
  watch?: Source | null;
  /** Another client's session to watch, with its `watch_token`. */
  follow?: Resume | null;
}

/** Change the settings that are named; the others are unchanged. */
export type UpdateSettings = { type: "settings" } & Partial<Settings>;

/** Use the wearer's current position and heading as the origin, facing +Z. */
export interface Recentre {
  type: "recentre";
}

/** Start or stop a recording on the server's disk, if the server allows it. */
export interface RecordSwitch {
  type: "record";
  on: boolean;
}

/** Measure height and tracker mounts during the next second, in which the wearer stands upright. */
export interface Calibrate {
  type: "calibrate";
  /** The arms are out to the sides; their reach is measured, too. */
  arms_out?: boolean;
}

/** A request for a pong with the same time. */
export interface Ping {
  type: "ping";
  time: number;
}

/** Control the watched replay; values that are null are unchanged. */
export interface Replay {
  type: "replay";
  playing?: boolean | null;
  /** Position in s from its beginning. */
  time?: number | null;
  /** Playback speed, 0.1 to 4. */
  speed?: number | null;
}

/** The answer to a hello, and to a change of settings. */
export interface Welcome {
  type: "welcome";
  session: string;
  /** Token that resumes the session. */
  token: string;
  /** Token with which others can watch the session. */
  watch_token: string;
  name: string;
  joints: string[];
  /** The joints, then the end sites. */
  points: string[];
  /** Index of every point's parent joint, -1 for the root. */
  parents: number[];
  /** Offset of every point from its parent in the T-pose, m. */
  rest_offset: ([number, number, number])[];
  /** Height of the body in m, from the floor to the crown. */
  height: number;
  /** Names of the signal's points. */
  signal: string[];
  settings: Settings;
  /** The server's own inputs, values for `watch`. */
  sources: Source[];
  /** Whether the server allows recordings. */
  recording: boolean;
  /** Length of the watched replay in s. */
  length: number | null;
  resumed: boolean;
  version: number;
}

/** New proportions of the body, inferred or set, from the next pose on. */
export interface ProportionsChanged {
  type: "proportions";
  /** Offset of every point from its parent in the T-pose, m. */
  rest_offset: ([number, number, number])[];
  /** Height in m, from the floor to the crown. */
  height: number;
}

/** A new placement of the signal's world in the body's: body = Ry(heading) · signal + offset. */
export interface PlacementChanged {
  type: "placed";
  /** m. */
  offset: [number, number, number];
  /** rad, about +Y. */
  heading: number;
}

/** A line of text for the wearer. */
export interface Notice {
  type: "said";
  text: string;
}

/** The reason for which the server closes the connection. */
export interface ErrorMessage {
  type: "error";
  reason: string;
}

/** The answer to a ping. */
export interface Pong {
  type: "pong";
  time: number;
}

export type ClientMessage = Hello | UpdateSettings | Recentre | RecordSwitch | Calibrate | Ping | Replay;

export type ServerMessage = Welcome | ProportionsChanged | PlacementChanged | Notice | ErrorMessage | Pong;
