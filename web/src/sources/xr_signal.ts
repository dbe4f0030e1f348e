/** A headset's frame as points of a signal: the viewer, and controllers or 25 joints of a hand. */

import type { SignalPoint } from "../protocol";

const FINGERS = ["index", "middle", "ring", "pinky"] as const;
const SEGMENTS = ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"] as const;

export const HAND_JOINTS: readonly string[] = [
  "wrist",
  ...["metacarpal", "phalanx-proximal", "phalanx-distal", "tip"].map((segment) => `thumb-${segment}`),
  ...FINGERS.flatMap((finger) => SEGMENTS.map((segment) => `${finger}-finger-${segment}`)),
];

/** The points of a headset, in the order of the hello. */
export const XR_POINTS: readonly string[] = [
  "headset",
  "left_controller",
  "right_controller",
  ...["left", "right"].flatMap((hand) => HAND_JOINTS.map((joint) => `${hand}:${joint}`)),
];

const INDEX: ReadonlyMap<string, number> = new Map(XR_POINTS.map((name, index) => [name, index]));

/** Reads what is tracked; what is out of sight is absent.
 *
 * A pose with `emulatedPosition` is the device's guess. Of a point that was ever measured guesses are left out: the
 * server knows better where a hidden hand is. A device that only guesses (or does not say) is believed.
 */
export class HeadsetReader {
  private readonly measured = new Set<number>();

  /** Return the tracked points of a frame, in the frame of `space`. */
  read(frame: XRFrame, space: XRReferenceSpace, sources: Iterable<XRInputSource>): SignalPoint[] {
    const points: SignalPoint[] = [];
    const add = (name: string, pose: XRPose | null | undefined): void => {
      const point = INDEX.get(name);
      if (!pose || point === undefined) return;
      if (!pose.emulatedPosition) this.measured.add(point);
      else if (this.measured.has(point)) return;
      points.push({ point, ...transformOf(pose.transform) });
    };
    add("headset", frame.getViewerPose(space));
    for (const { handedness, hand, gripSpace, targetRayMode } of sources) {
      // A transient pointer is where somebody looks while they pinch, not where a hand is.
      if (handedness === "none" || targetRayMode === "transient-pointer") continue;
      if (hand) {
        for (const joint of hand.values()) add(`${handedness}:${joint.jointName}`, frame.getJointPose?.(joint, space));
      } else if (gripSpace) {
        add(`${handedness}_controller`, frame.getPose(gripSpace, space));
      }
    }
    return points;
  }
}

function transformOf({ position: p, orientation: q }: XRRigidTransform): Pick<SignalPoint, "position" | "rotation"> {
  return { position: [p.x, p.y, p.z], rotation: [q.w, q.x, q.y, q.z] };
}
