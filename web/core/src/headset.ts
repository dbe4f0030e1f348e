/** A headset's frame as points of the body: where each joint is by the device that wears it (bodysense_live.protocols.webxr). */

import { add, conjugate, fromAxes, multiply, rotate, scaled, UPRIGHT } from "./math.js";
import { seenBody } from "./seen_body.js";
import type { Point, Quaternion, Vector } from "./types.js";

type Side = "left" | "right";

const turn = (x: Vector, y: Vector, z: Vector): Quaternion => conjugate(fromAxes(x, y, z));

// Device ← joint, by the axes x, y, z of the device's frame in the T-pose.
const LOOKING = turn([-1, 0, 0], [0, 1, 0], [0, 0, -1]);
const HAND: Readonly<Record<Side, Quaternion>> = {
  left: turn([0, 0, 1], [0, 1, 0], [-1, 0, 0]),
  right: turn([0, 0, -1], [0, 1, 0], [1, 0, 0]),
};
const GRIP: Readonly<Record<Side, Quaternion>> = {
  left: turn([0, -1, 0], [-1, 0, 0], [0, 0, -1]),
  right: turn([0, 1, 0], [1, 0, 0], [0, 0, -1]),
};
// m, of the joint from the device, in the joint's axes: minus the landmarks of the default body (default_body.json).
const HEAD_FROM_EYES: Vector = [0, -0.038, -0.1027];
const WRIST_FROM_PALM: Readonly<Record<Side, Vector>> = {
  left: [-0.0529, 0.0222, 0.003],
  right: [0.0529, 0.0222, 0.003],
};
const [DEVICE, CAMERA] = [0.001, 0.01]; // m, expected errors of headsets and controllers, and of hands that cameras see
const STILL: Vector = [0, 0, 0];
const THUMB = ["thumb-metacarpal", "thumb-phalanx-proximal", "thumb-phalanx-distal", "thumb-tip"];
const SEGMENTS = ["phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"];

/** WebXR's joints of fingers by name, as points of the body without the side. Metacarpals have none. */
const OF_FINGER: ReadonlyMap<string, string> = new Map(
  ["1", "2", "3", "_tip"].flatMap((end, k) => [
    [THUMB[k]!, `thumb${end}`] as const,
    ...["index", "middle", "ring", "pinky"].map((name) => [`${name}-finger-${SEGMENTS[k]}`, `${name}${end}`] as const),
  ]),
);

/** Reader of tracked points; points out of sight are absent.
 *
 * A pose with `emulatedPosition` is the device's guess. Guesses are dropped for points that were
 * measured before: the core predicts hidden hands better. They are used if the device never measures the point.
 */
export class HeadsetReader {
  private readonly measured = new Set<string>();

  /** Points of a frame, in the frame of `space`; of several devices on one joint the last counts.
   *
   * `size`: the wearer's height by the default body's, for the distance from a device to its joint.
   */
  read(frame: XRFrame, space: XRReferenceSpace, sources: Iterable<XRInputSource>, size = 1): Point[] {
    const points = new Map<string, Point>();
    const put = (
      name: string,
      pose: XRPose | null | undefined,
      accuracy: number,
      turned: Quaternion | null = null,
      shift: Vector = STILL,
    ): void => {
      if (!pose) return;
      if (!pose.emulatedPosition) this.measured.add(name);
      else if (this.measured.has(name)) return;
      const { position: p, orientation: q } = pose.transform;
      const rotation = multiply([q.w, q.x, q.y, q.z], turned ?? UPRIGHT);
      const position = add([p.x, p.y, p.z], rotate(rotation, scaled(shift, size)));
      points.set(name, { name, position, rotation: turned && rotation, accuracy });
    };
    for (const point of seenBody(frame, space)) points.set(point.name, point);
    put("head", frame.getViewerPose(space), DEVICE, LOOKING, HEAD_FROM_EYES);
    for (const { handedness, hand, gripSpace, targetRayMode } of sources) {
      // A transient pointer follows the gaze during a pinch; it is not the hand's position.
      if (handedness === "none" || targetRayMode === "transient-pointer") continue;
      for (const joint of hand?.values() ?? []) {
        const finger = OF_FINGER.get(joint.jointName);
        const pose = frame.getJointPose?.(joint, space);
        if (joint.jointName === "wrist") put(`${handedness}_wrist`, pose, CAMERA, HAND[handedness]);
        else if (finger) put(`${handedness}_${finger}`, pose, CAMERA);
      }
      if (!hand && gripSpace)
        put(
          `${handedness}_wrist`,
          frame.getPose(gripSpace, space),
          DEVICE,
          GRIP[handedness],
          WRIST_FROM_PALM[handedness],
        );
    }
    return [...points.values()];
  }
}
