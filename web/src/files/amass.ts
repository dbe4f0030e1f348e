/** Motion of the AMASS layout (.npz): SMPL-H or SMPL-X poses, Z up; turned to +Y up. */

import type { Clip } from "../body/clip";
import { multiply, quaternionAt, rotate, vectorAt, type Quaternion } from "../body/math";
import { numbers, type Archive } from "./npz";
import type { Skeleton } from "../body/skeleton";

const Z_UP_TO_Y_UP: Quaternion = [Math.SQRT1_2, -Math.SQRT1_2, 0, 0];
const JOINTS = 52;
const MOST_FRAMES = 60_000;
export const AMASS_ARRAYS: readonly string[] = ["poses", "trans", "mocap_framerate", "mocap_frame_rate"];

/** Read a motion of AMASS. Throws an Error of a few words if the arrays do not fit. */
export function amassClip(archive: Archive, name: string, skeleton: Skeleton): Clip {
  const poses = numbers(archive, "poses", [null, null]);
  const [frames, width] = poses.shape;
  if (width !== 156 && width !== 165)
    throw new Error(`its poses have ${width} numbers, not the 156 of SMPL-H or the 165 of SMPL-X`);
  if (frames > MOST_FRAMES) throw new Error(`it has ${frames} frames; this page takes ${MOST_FRAMES}: cut it`);
  if (frames < 2) throw new Error("it has less than two frames");
  const trans = numbers(archive, "trans", [frames, 3]).values;
  const rateKey = ["mocap_framerate", "mocap_frame_rate"].find((key) => archive.has(key));
  if (!rateKey) throw new Error("it does not say its frame rate (mocap_framerate)");
  const rate = numbers(archive, rateKey).values[0];
  const root = new Float32Array(3 * frames);
  const rotation = new Float32Array(4 * JOINTS * frames);
  for (let frame = 0; frame < frames; frame++) {
    root.set(rotate(Z_UP_TO_Y_UP, vectorAt(trans, frame)), 3 * frame);
    for (let joint = 0; joint < JOINTS; joint++) {
      const part = joint + (width === 165 && joint >= 22 ? 3 : 0); // SMPL-X has jaw and eyes in between
      putExponential(poses.values, width * frame + 3 * part, rotation, 4 * (JOINTS * frame + joint));
    }
    rotation.set(multiply(Z_UP_TO_Y_UP, quaternionAt(rotation, JOINTS * frame)), 4 * JOINTS * frame);
  }
  return { name, skeleton, rate, frames, root, rotation };
}

/** Put the rotation of the rotation vector at `from` into `out` at `to`; nothing is allocated, for a page that starts. */
function putExponential(vectors: Float64Array, from: number, out: Float32Array, to: number): void {
  const [x, y, z] = [vectors[from], vectors[from + 1], vectors[from + 2]];
  const angle = Math.hypot(x, y, z);
  const share = angle < 1e-12 ? 0.5 : Math.sin(angle / 2) / angle;
  out[to] = Math.cos(angle / 2);
  out[to + 1] = share * x;
  out[to + 2] = share * y;
  out[to + 3] = share * z;
}
