/** The body's tree, and where a pose puts its points. */

export interface Skeleton {
  readonly joints: number; // points 0 … joints − 1 turn; the rest are end sites
  readonly points: readonly string[];
  readonly parents: readonly number[]; // one per point; −1 for the root
  readonly restOffset: Float32Array; // (points × 3) m
}

/** World positions (points × 3) and rotations (joints × 4, wxyz) of a pose. */
export interface Body {
  readonly position: Float32Array;
  readonly rotation: Float32Array;
}

/** A tree as rows of JSON: those of `default_body.json`. */
export interface SkeletonRows {
  readonly joints: readonly SkeletonRow[];
  readonly end_sites: readonly SkeletonRow[];
}

interface SkeletonRow {
  readonly name: string;
  readonly parent: string | null;
  readonly offset: readonly number[];
}

export function skeletonOfRows({ joints, end_sites }: SkeletonRows): Skeleton {
  const rows = [...joints, ...end_sites];
  const points = rows.map(({ name }) => name);
  return {
    joints: joints.length,
    points,
    parents: rows.map(({ parent }) => (parent === null ? -1 : points.indexOf(parent))),
    restOffset: Float32Array.from(rows.flatMap(({ offset }) => offset)),
  };
}

/** Return the tree with other proportions. */
export function withOffsets(skeleton: Skeleton, restOffset: Float32Array): Skeleton {
  return { ...skeleton, restOffset };
}

/** Forward kinematics: positions of all points from the root's place and rotations parent ← joint. */
export function place(skeleton: Skeleton, root: ArrayLike<number>, local: ArrayLike<number>): Body {
  const { joints, parents, restOffset } = skeleton;
  const position = new Float32Array(3 * parents.length);
  const rotation = new Float32Array(4 * joints);
  worldRotations(skeleton, local, rotation);
  parents.forEach((parent, point) => {
    if (parent < 0) {
      for (let k = 0; k < 3; k++) position[k] = root[k];
      return;
    }
    rotate(rotation, 4 * parent, restOffset, 3 * point, position, 3 * point);
    for (let k = 0; k < 3; k++) position[3 * point + k] += position[3 * parent + k];
  });
  return { position, rotation };
}

/** Rotations world ← joint (joints × 4, wxyz) from those parent ← joint. */
export function worldRotations({ joints, parents }: Skeleton, local: ArrayLike<number>, out: Float32Array): void {
  for (let joint = 0; joint < joints; joint++) {
    if (parents[joint] >= 0) multiply(out, 4 * parents[joint], local, 4 * joint, out, 4 * joint);
    else for (let k = 0; k < 4; k++) out[4 * joint + k] = local[4 * joint + k];
  }
}

/** Height of the rest pose, lowest to highest point, metres. */
export function restHeight(skeleton: Skeleton): number {
  const [low, high] = restRange(skeleton);
  return high - low;
}

/** How high the root stands over the lowest point in the rest pose, metres. */
export function rootHeight(skeleton: Skeleton): number {
  return -restRange(skeleton)[0];
}

function restRange(skeleton: Skeleton): [number, number] {
  const identity = Float32Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
  const { position } = place(skeleton, [0, 0, 0], identity);
  const heights = skeleton.parents.map((_, point) => position[3 * point + 1]);
  return [Math.min(...heights), Math.max(...heights)];
}

/** Where a point of the rest pose is over the floor, metres. */
export function restPoint({ points, parents, restOffset }: Skeleton, name: string): [number, number, number] {
  const place: [number, number, number] = [0, 0, 0];
  for (let point = points.indexOf(name); point >= 0; point = parents[point])
    for (let k = 0; k < 3; k++) place[k] += restOffset[3 * point + k];
  return place;
}

/** Mean distance of the joints of two placed bodies, metres. */
export function meanDistance(a: Body, b: Body, joints: number): number {
  let sum = 0;
  for (let joint = 0; joint < joints; joint++) {
    const at = 3 * joint;
    sum += Math.hypot(
      a.position[at] - b.position[at],
      a.position[at + 1] - b.position[at + 1],
      a.position[at + 2] - b.position[at + 2],
    );
  }
  return sum / joints;
}

/** Hamilton product a·b of wxyz quaternions inside arrays. */
export function multiply(
  a: ArrayLike<number>,
  i: number,
  b: ArrayLike<number>,
  j: number,
  out: Float32Array,
  k: number,
): void {
  const aw = a[i];
  const ax = a[i + 1];
  const ay = a[i + 2];
  const az = a[i + 3];
  const bw = b[j];
  const bx = b[j + 1];
  const by = b[j + 2];
  const bz = b[j + 3];
  out[k] = aw * bw - ax * bx - ay * by - az * bz;
  out[k + 1] = aw * bx + ax * bw + ay * bz - az * by;
  out[k + 2] = aw * by - ax * bz + ay * bw + az * bx;
  out[k + 3] = aw * bz + ax * by - ay * bx + az * bw;
}

function rotate(q: ArrayLike<number>, i: number, v: ArrayLike<number>, j: number, out: Float32Array, k: number): void {
  const [w, x, y, z] = [q[i], q[i + 1], q[i + 2], q[i + 3]];
  const [vx, vy, vz] = [v[j], v[j + 1], v[j + 2]];
  const tx = 2 * (y * vz - z * vy);
  const ty = 2 * (z * vx - x * vz);
  const tz = 2 * (x * vy - y * vx);
  out[k] = vx + w * tx + y * tz - z * ty;
  out[k + 1] = vy + w * ty + z * tx - x * tz;
  out[k + 2] = vz + w * tz + x * ty - y * tx;
}
