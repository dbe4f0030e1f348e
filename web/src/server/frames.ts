/** The binary messages of the protocol (docs/protocol.md): signals both ways, poses and truths of the server. */

import type { Point } from "../body/observation";
import {
  ACCURACY_UNIT,
  CONTACTS,
  HAS_POSITION,
  HAS_ROTATION,
  POINT_BYTES,
  POSE,
  POSE_HEAD_BYTES,
  SIGNAL,
  SIGNAL_HEAD_BYTES,
} from "./protocol";

/** A point of a signal frame: by its place in the hello, in the signal's own world.
 *
 * If its accuracy is left out or 0, the server assumes the usual accuracy of such a point.
 */
export type SignalPoint = Omit<Point, "name"> & { readonly point: number };

export interface SignalFrame {
  sequence: number;
  /** s, of the client's own clock. */
  time: number;
  points: SignalPoint[];
}

export interface PoseFrame {
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
  /** (points) 0 … 255, the probability that a point was hidden: 255 if it was not measured; null in a true body. */
  hidden: Uint8Array | null;
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
  const isPose = view.getUint8(0) === POSE; // else a truth
  const joints = view.getUint16(2, true);
  const floats = (at: number, count: number) => new Float32Array(buffer.slice(at, at + 4 * count));
  const errors = POSE_HEAD_BYTES + 12 + 16 * joints;
  const hidden = errors + 4 * points;
  return {
    sequence: view.getUint32(4, true),
    time: view.getFloat64(8, true),
    rootPosition: floats(POSE_HEAD_BYTES, 3),
    rotation: floats(POSE_HEAD_BYTES + 12, 4 * joints),
    expectedError: isPose ? floats(errors, points) : null,
    hidden: isPose ? new Uint8Array(buffer, hidden, points) : null,
    microseconds: isPose ? view.getUint32(hidden + points + CONTACTS, true) : 0,
  };
}
