/** BVH: the skeleton's tree in centimetres; channels turn in the order Z, X, Y (R = Rz · Rx · Ry), as the library's. */

import { Euler, Quaternion } from "three";
import type { Motion } from "./resample";
import type { Skeleton } from "../body/skeleton";

const CENTIMETRES = 100;
const DEGREES = 180 / Math.PI;

export function bvhText(skeleton: Skeleton, motion: Motion): string {
  const order: number[] = [];
  const lines = ["HIERARCHY", ...hierarchy(skeleton, 0, "", order)];
  lines.push("MOTION", `Frames: ${motion.frames}`, `Frame Time: ${(1 / motion.rate).toFixed(7)}`);
  for (let frame = 0; frame < motion.frames; frame++) {
    const place = Array.from(motion.root.subarray(3 * frame, 3 * frame + 3), (metres) =>
      (metres * CENTIMETRES).toFixed(4),
    );
    const angles = order.flatMap((joint) => {
      const at = 4 * (skeleton.joints * frame + joint);
      return eulerZXY(motion.rotation.subarray(at, at + 4)).map((angle) => (angle * DEGREES).toFixed(4));
    });
    lines.push([...place, ...angles].join(" "));
  }
  return `${lines.join("\n")}\n`;
}

function hierarchy(skeleton: Skeleton, point: number, indent: string, order: number[]): string[] {
  const isJoint = point < skeleton.joints;
  const offset = skeleton.restOffset.subarray(3 * point, 3 * point + 3);
  const head = point === 0 ? `ROOT ${skeleton.points[0]}` : isJoint ? `JOINT ${skeleton.points[point]}` : "End Site";
  const inner = `${indent}  `;
  const numbers = Array.from(offset, (metres) => ((point === 0 ? 0 : metres) * CENTIMETRES).toFixed(4)).join(" ");
  const lines = [`${indent}${head}`, `${indent}{`, `${inner}OFFSET ${numbers}`];
  if (isJoint) {
    order.push(point);
    const moves = point === 0 ? "6 Xposition Yposition Zposition" : "3";
    lines.push(`${inner}CHANNELS ${moves} Zrotation Xrotation Yrotation`);
    skeleton.parents.forEach((parent, child) => {
      if (parent === point) lines.push(...hierarchy(skeleton, child, inner, order));
    });
  }
  lines.push(`${indent}}`);
  return lines;
}

/** Angles z, x, y (rad) of a wxyz quaternion with R = Rz · Rx · Ry. */
export function eulerZXY([w, x, y, z]: Iterable<number>): [number, number, number] {
  const euler = new Euler().setFromQuaternion(new Quaternion(x, y, z, w), "ZXY");
  return [euler.z, euler.x, euler.y];
}
