/** The skeleton, and forward kinematics. */

import { add, distance, multiply, quaternionAt, rotate, vectorAt, type Vector } from "./math";

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
  const { parents, restOffset } = skeleton;
  const position = new Float32Array(3 * parents.length);
  const rotation = worldRotations(skeleton, local);
  parents.forEach((parent, point) => {
    const offset = parent < 0 ? vectorAt(root, 0) : rotate(quaternionAt(rotation, parent), vectorAt(restOffset, point));
    position.set(parent < 0 ? offset : add(vectorAt(position, parent), offset), 3 * point);
  });
  return { position, rotation };
}

/** Rotations world ← joint (joints × 4, wxyz) from those parent ← joint. */
export function worldRotations({ joints, parents }: Skeleton, local: ArrayLike<number>): Float32Array {
  const world = new Float32Array(4 * joints);
  for (let joint = 0; joint < joints; joint++) {
    const [parent, turn] = [parents[joint], quaternionAt(local, joint)];
    world.set(parent < 0 ? turn : multiply(quaternionAt(world, parent), turn), 4 * joint);
  }
  return world;
}

/** Height of the rest pose, lowest to highest point, metres. */
export function restHeight(skeleton: Skeleton): number {
  const [low, high] = restRange(skeleton);
  return high - low;
}

/** Height of the crown above the soles in the rest pose, metres: what people call their height. */
export function stature(skeleton: Skeleton): number {
  return restPoint(skeleton, "head_top")[1];
}

/** Height of the root above the lowest point in the rest pose, metres. */
export function rootHeight(skeleton: Skeleton): number {
  return -restRange(skeleton)[0];
}

function restRange(skeleton: Skeleton): [number, number] {
  const heights = restPoints(skeleton).map(([, y]) => y);
  return [Math.min(...heights), Math.max(...heights)];
}

/** Where the points of the rest pose are, metres from the root. */
export function restPoints({ parents, restOffset }: Skeleton): Vector[] {
  const found: Vector[] = [];
  parents.forEach((parent, point) =>
    found.push(parent < 0 ? [0, 0, 0] : add(found[parent], vectorAt(restOffset, point))),
  );
  return found;
}

/** Where a named point of the rest pose is, metres from the root. */
export function restOf(skeleton: Skeleton): (name: string) => Vector {
  const rest = restPoints(skeleton);
  return (name) => rest[skeleton.points.indexOf(name)];
}

/** Where a point of the rest pose is over the floor, metres. */
export function restPoint(skeleton: Skeleton, name: string): Vector {
  return add(restOf(skeleton)(name), vectorAt(skeleton.restOffset, 0));
}

/** Mean distance of the joints of two placed bodies, metres. */
export function meanDistance(a: Body, b: Body, joints: number): number {
  let sum = 0;
  for (let joint = 0; joint < joints; joint++)
    sum += distance(vectorAt(a.position, joint), vectorAt(b.position, joint));
  return sum / joints;
}
