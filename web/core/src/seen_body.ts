/** The joints of a body that a headset itself tracks (WebXR Body Tracking), as points to complete a body from.
 *
 * Joints are turned by the specification: −Z points along the bone, −Y out of the palm and the sole. A joint with
 * `emulatedPosition` is the headset's guess and is left out: the core completes it with the rest of the body.
 */

import { conjugate, cross, dot, fromAxes, multiply, scaled, subtract, unit } from "./math.js";
import type { Point, Quaternion, Vector } from "./types.js";

/** A frame of a session that may have body tracking: spaces of joints by name. */
interface BodyFrame extends XRFrame {
  readonly body?: ReadonlyMap<string, XRSpace> | null;
}

interface Joint {
  readonly name: string; // our joint
  readonly fromOurs: Quaternion; // the headset's joint ← ours, in the T-pose
  readonly isPlaced: boolean; // its position is ours, too; along a spine runtimes differ
}

const ACCURACY = 0.02; // m, expected error of a joint that cameras see through clothes
const [UP, FORWARD, BACK]: readonly Vector[] = [
  [0, 1, 0],
  [0, 0, 1],
  [0, 0, -1],
];
// Directions of bones of the default body in the T-pose.
const [LOWER_BACK, UPPER_BACK, DOWN, TOES]: readonly Vector[] = [
  [0, 0.953, -0.303],
  [0, 0.988, 0.155],
  [0, -1, 0],
  [0, -0.212, 0.977],
];

function joint(name: string, bone: Vector, up: Vector, isPlaced = true): Joint {
  const z = scaled(unit(bone), -1);
  const y = unit(subtract(up, scaled(z, dot(up, z))));
  return { name, fromOurs: conjugate(fromAxes(cross(y, z), y, z)), isPlaced };
}

/** Joints of the specification that are also ours. Fingers come with hand tracking. */
const JOINTS: ReadonlyMap<string, Joint> = new Map<string, Joint>([
  ["hips", joint("pelvis", LOWER_BACK!, BACK!, false)],
  ["spine-upper", joint("spine3", UPPER_BACK!, BACK!, false)],
  ...(["left", "right"] as const).flatMap((side): [string, Joint][] => {
    const out = side === "left" ? 1 : -1;
    const [outward, sole]: readonly Vector[] = [
      [out, 0, 0],
      [-0.034 * out, -0.316, 0.948],
    ];
    return [
      [`${side}-arm-upper`, joint(`${side}_shoulder`, outward!, UP!)],
      [`${side}-arm-lower`, joint(`${side}_elbow`, outward!, UP!)],
      [`${side}-upper-leg`, joint(`${side}_hip`, DOWN!, FORWARD!)],
      [`${side}-lower-leg`, joint(`${side}_knee`, DOWN!, FORWARD!)],
      [`${side}-foot-ankle`, joint(`${side}_ankle`, sole!, UP!)],
      [`${side}-foot-ball`, joint(`${side}_foot`, TOES!, UP!)],
    ];
  }),
]);

/** Points of the headset's own body in a frame, in the frame of `space`; none without one. */
export function seenBody(frame: XRFrame, space: XRReferenceSpace): Point[] {
  const { body } = frame as BodyFrame;
  if (!body) return [];
  const points: Point[] = [];
  for (const [theirs, { name, fromOurs, isPlaced }] of JOINTS) {
    const found = body.get(theirs);
    const pose = found && frame.getPose(found, space);
    if (!pose || pose.emulatedPosition) continue;
    const { position: p, orientation: q } = pose.transform;
    const rotation = multiply([q.w, q.x, q.y, q.z], fromOurs);
    points.push(isPlaced ? { name, position: [p.x, p.y, p.z], rotation, accuracy: ACCURACY } : { name, rotation });
  }
  return points;
}
