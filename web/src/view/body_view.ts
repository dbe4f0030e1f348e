/** A body of tapered capsules: one instanced cylinder a bone, one instanced ball a point, an egg for the head. */

import {
  Color,
  CylinderGeometry,
  Group,
  InstancedBufferAttribute,
  InstancedMesh,
  Matrix4,
  MeshLambertMaterial,
  Quaternion,
  SphereGeometry,
  Vector3,
} from "three";
import { quaternionAt } from "../body/math";
import { restHeight, type Body, type Skeleton } from "../body/skeleton";

/** Radii as shares of a body's height: across (left to right) and deep (back to front). */
const RADII: readonly (readonly [RegExp, number, number])[] = [
  [/^pelvis$/, 0.078, 0.06],
  [/^spine[12]$/, 0.076, 0.056],
  [/^spine3$/, 0.085, 0.06],
  [/^neck$/, 0.03, 0.032],
  [/^head$/, 0.03, 0.034],
  [/^head_top$/, 0.044, 0.056], // of the egg
  [/_collar$/, 0.036, 0.036],
  [/_hip$/, 0.048, 0.05],
  [/_knee$/, 0.034, 0.036],
  [/_ankle$/, 0.024, 0.026],
  [/_(foot|toe)$/, 0.02, 0.016],
  [/_shoulder$/, 0.032, 0.032],
  [/_elbow$/, 0.026, 0.026],
  [/_wrist$/, 0.018, 0.02],
  [/_thumb/, 0.0062, 0.0062],
  [/_(index|middle|ring|pinky)/, 0.0054, 0.0054],
];
const UP = new Vector3(0, 1, 0);
const HEAD = "head_top"; // the bone from the head's joint up to here is the head
const EGG = 1.5; // as tall as wide
const ONE = new Vector3(1, 1, 1);

export class BodyView {
  readonly group = new Group();
  private readonly balls: InstancedMesh;
  private readonly bones: InstancedMesh;
  private readonly boneOfPoint: readonly Matrix4[]; // in the frame of the joint that carries it
  private readonly ballOfPoint: readonly Matrix4[]; // in the frame of the point, or of its joint for an end site
  private readonly frames: readonly Matrix4[];

  constructor(
    private readonly skeleton: Skeleton,
    opacity: number,
  ) {
    const count = skeleton.points.length;
    const height = restHeight(skeleton);
    const radii = skeleton.points.map((name): [number, number] => {
      const [, across, deep] = RADII.find(([pattern]) => pattern.test(name)) ?? [name, 0.02, 0.02];
      return [across * height, deep * height];
    });
    const material = materialOf(opacity);
    const shapes = [new SphereGeometry(1, 16, 12), new CylinderGeometry(1, 1, 1, 20, 1, true)];
    [this.balls, this.bones] = shapes.map((shape) => new InstancedMesh(shape, material, count));
    const tapering = [new Float32Array(2 * count).fill(1), tapers(skeleton, radii)];
    shapes.forEach((shape, k) => shape.setAttribute("taper", new InstancedBufferAttribute(tapering[k], 2)));
    this.group.add(this.balls, this.bones);
    for (const mesh of [this.balls, this.bones]) {
      mesh.frustumCulled = false;
      mesh.castShadow = opacity >= 1;
    }
    this.ballOfPoint = skeleton.points.map((_, point) => ballMatrix(skeleton, point, radii));
    this.boneOfPoint = skeleton.points.map((_, point) => boneMatrix(skeleton, point, radii));
    this.frames = skeleton.points.map(() => new Matrix4());
  }

  /** Show a pose; `colour` fills in the colour of a point. */
  show(body: Body, colour: (point: number, out: Color) => Color): void {
    const { parents, joints } = this.skeleton;
    const [matrix, place, turn] = [new Matrix4(), new Vector3(), new Quaternion()];
    const [tint, other] = [new Color(), new Color()];
    this.frames.forEach((frame, point) => {
      const [w, x, y, z] = quaternionAt(body.rotation, point < joints ? point : parents[point]);
      frame.compose(place.fromArray(body.position, 3 * point), turn.set(x, y, z, w), ONE);
    });
    parents.forEach((parent, point) => {
      colour(point, tint);
      this.balls.setMatrixAt(point, matrix.multiplyMatrices(this.frames[point], this.ballOfPoint[point]));
      this.balls.setColorAt(point, tint);
      const carrier = this.frames[Math.max(parent, 0)];
      this.bones.setMatrixAt(point, matrix.multiplyMatrices(carrier, this.boneOfPoint[point]));
      this.bones.setColorAt(point, parent < 0 ? tint : tint.lerp(colour(parent, other), 0.5));
    });
    for (const mesh of [this.balls, this.bones]) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
  }

  dispose(): void {
    this.group.removeFromParent();
    for (const mesh of [this.balls, this.bones]) {
      mesh.geometry.dispose();
      mesh.dispose();
    }
  }
}

/** One material for balls and cylinders: a graphics card compiles it once. A cylinder's beginning is `taper` times as
 * thick as its end.
 */
function materialOf(opacity: number): MeshLambertMaterial {
  const material = new MeshLambertMaterial({ transparent: opacity < 1, opacity, depthWrite: opacity >= 1 });
  material.onBeforeCompile = (shader) => {
    shader.vertexShader = `attribute vec2 taper;\n${shader.vertexShader}`.replace(
      "#include <begin_vertex>",
      "#include <begin_vertex>\n  transformed.xz *= mix(taper, vec2(1.0), position.y + 0.5);",
    );
  };
  return material;
}

function tapers(skeleton: Skeleton, radii: readonly [number, number][]): Float32Array {
  return Float32Array.from(
    skeleton.parents.flatMap((parent, point) => {
      if (parent < 0 || skeleton.points[point].endsWith("_collar")) return [1, 1]; // no cone from a chest to a collar
      return [0, 1].map((axis) => radii[parent][axis] / radii[point][axis]);
    }),
  );
}

/** Matrix from the unit ball to the ellipsoid of a point; the head's ends at the top of the head. */
function ballMatrix(skeleton: Skeleton, point: number, radii: readonly [number, number][]): Matrix4 {
  const [across, deep] = radii[point];
  if (skeleton.points[point] !== HEAD) return new Matrix4().makeScale(across, (across + deep) / 2, deep);
  const half = EGG * across;
  return new Matrix4().makeTranslation(0, -half, 0).scale(new Vector3(across, half, deep));
}

/** The unit cylinder laid along a bone, as thick as the point that it leads to. */
function boneMatrix(skeleton: Skeleton, point: number, radii: readonly [number, number][]): Matrix4 {
  if (skeleton.parents[point] < 0 || skeleton.points[point] === HEAD) return new Matrix4().makeScale(0, 0, 0);
  const offset = new Vector3().fromArray(skeleton.restOffset, 3 * point);
  const length = offset.length();
  const turn = new Quaternion().setFromUnitVectors(UP, length > 0 ? offset.clone().normalize() : UP);
  const size = new Vector3(radii[point][0], length, radii[point][1]);
  return new Matrix4().compose(offset.multiplyScalar(0.5), turn, size);
}
