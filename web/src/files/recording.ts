/** Recordings of tracked points (docs/recording.md), `.npz` or `.jsonl`. */

import { quaternionAt, vectorAt, type Quaternion, type Vector } from "../body/math";
import { numbers, texts, type Archive } from "./npz";
import { ACCURACY, type Observation, type Point } from "../body/observation";

const FORMAT = "bodysense recording 1";
// Arrays that are read from a .npz recording.
export const RECORDING_ARRAYS: readonly string[] =
  "format points time position rotation has_position has_rotation accuracy".split(" ");
const LONGEST_LINE = 65_536; // characters: a frame of a hundred points has a fifth of it
const MOST_FRAMES = 200_000;
const HEADSET_POINTS: ReadonlySet<string> = new Set(["head", "left_wrist", "right_wrist"]);

/** Return the frames of a .npz recording. Throws an Error of a few words for other archives. */
export function recordingOf(archive: Archive): Observation[] {
  const format = texts(archive, "format")[0];
  if (format !== FORMAT) throw new Error(`it has the format ${format}, and this page reads ${FORMAT}`);
  const points = texts(archive, "points");
  const time = numbers(archive, "time", [null]).values;
  const [T, P] = [time.length, points.length];
  if (T > MOST_FRAMES) throw new Error(`it has ${T} frames; this page takes ${MOST_FRAMES}: cut it`);
  const position = numbers(archive, "position", [T, P, 3]).values;
  const rotation = numbers(archive, "rotation", [T, P, 4]).values;
  const hasPosition = numbers(archive, "has_position", [T, P]).values;
  const hasRotation = numbers(archive, "has_rotation", [T, P]).values;
  const accuracy = archive.has("accuracy") ? numbers(archive, "accuracy", [T, P]).values : null;
  return checked(
    Array.from(time, (seconds, frame) => ({
      time: seconds,
      points: points.flatMap((name, p): Point[] => {
        const k = frame * P + p;
        if (!hasPosition[k] && !hasRotation[k]) return [];
        return [
          {
            name,
            position: hasPosition[k] ? vectorAt(position, k) : null,
            rotation: hasRotation[k] ? quaternionAt(rotation, k) : null,
            accuracy: accuracy?.[k] ?? usual(name),
          },
        ];
      }),
    })),
  );
}

/** Return the frames of a .jsonl recording. Throws an Error of a few words for other text. */
export function recordingOfLines(text: string): Observation[] {
  const lines = text.split("\n");
  const long = lines.findIndex((line) => line.length > LONGEST_LINE);
  if (long >= 0) throw new Error(`its line ${long + 1} has ${lines[long].length} characters, more than any frame has`);
  if (lines.length > MOST_FRAMES)
    throw new Error(`it has ${lines.length} frames; this page takes ${MOST_FRAMES}: cut it`);
  const rows = lines.flatMap((line, k) => (line.trim() ? [object(line, k + 1)] : []));
  if (rows[0]?.["format"] !== FORMAT) throw new Error(`its first line is no header with the format ${FORMAT}`);
  const accuracies = record(rows[0]["accuracy"]);
  return checked(
    rows.slice(1).map((row, frame): Observation => {
      const { time } = row;
      if (typeof time !== "number") throw new Error(`its frame ${frame} has no time`);
      const [position, rotation, own] = [record(row["position"]), record(row["rotation"]), record(row["accuracy"])];
      const names = [...new Set([...Object.keys(position), ...Object.keys(rotation)])];
      return {
        time,
        points: names.map((name) => ({
          name,
          position: list(position[name], 3, frame) as Vector | null,
          rotation: list(rotation[name], 4, frame) as Quaternion | null,
          accuracy: Number(own[name] ?? accuracies[name] ?? usual(name)),
        })),
      };
    }),
  );
}

function checked(frames: Observation[]): Observation[] {
  if (frames.length < 2) throw new Error("it has less than two frames");
  const wrong = frames.findIndex(({ time }, k) => !Number.isFinite(time) || (k > 0 && time <= frames[k - 1].time));
  if (wrong >= 0) throw new Error(`its time does not increase at frame ${wrong}`);
  return frames;
}

function usual(name: string): number {
  return HEADSET_POINTS.has(name) ? ACCURACY.headset : ACCURACY.tracker;
}

function object(line: string, number: number): Record<string, unknown> {
  try {
    return record(JSON.parse(line) as unknown);
  } catch {
    throw new Error(`its line ${number} cannot be read; it may have been cut short`);
  }
}

function record(value: unknown): Record<string, unknown> {
  return typeof value === "object" && value !== null && !Array.isArray(value) ? (value as Record<string, unknown>) : {};
}

function list(value: unknown, count: number, frame: number): readonly number[] | null {
  if (value === undefined) return null;
  if (Array.isArray(value) && value.length === count && value.every((n) => typeof n === "number"))
    return value as number[];
  throw new Error(`its frame ${frame} has no ${count} numbers where it should`);
}
