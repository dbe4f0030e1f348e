/** Tilt and roll of a camera, from an upright person (bodysense.devices.video.camera_level). */

import { add, dot, rotate, scaled, size, subtract, unit, type Quaternion, type Vector } from "../../body/math";
import {
  ENOUGH,
  LONGEST_ANGLE,
  LONGEST_MEAN,
  MOST_ROLLED,
  STEEPEST,
  SWAY,
  TRUNK_SHARE,
  UPRIGHT,
  VISIBLE,
} from "./constants";
import { turnedHands } from "./hands";
import { placesOf, type Landmarks } from "./landmark_marks";

const RADIANS = Math.PI / 180;

export class CameraLevel {
  private tilt = 0; // rad, by which the camera looks down
  private roll = 0; // rad, by which upright things lean to the right in the picture
  private stood = 0; // s
  private trunk = 0; // rad, tilt if a sitting person's trunk is upright
  private sat = 0; // s
  private time = -Infinity; // s, of the last frame that counted

  /** Add a frame of unprocessed landmarks at `time` s. */
  step(landmarks: Landmarks, time: number, isSeated: boolean): void {
    const up = isSeated ? trunkOf(landmarks) : upright(landmarks);
    if (!up) return;
    const elapsed = Math.min(time - this.time, LONGEST_ANGLE);
    const tilt = tiltOf(up);
    if (isSeated) {
      const share = this.sat === 0 ? 1 : elapsed / (this.sat + elapsed);
      this.trunk += share * (tilt - this.trunk);
      this.sat = Math.min(this.sat + elapsed, LONGEST_MEAN);
    } else {
      const share = this.stood === 0 ? 1 : elapsed / (this.stood + elapsed);
      this.tilt += share * (tilt - this.tilt);
      this.roll += share * (Math.atan2(up[0], up[1]) - this.roll);
      this.stood = Math.min(this.stood + elapsed, LONGEST_MEAN);
    }
    this.time = time;
  }

  /** Turns the axes of an upright camera to the room's. */
  get room(): Quaternion {
    const share = this.sat === 0 ? 1 : this.stood / (this.stood + ENOUGH);
    const tilt = share * this.tilt + (1 - share) * TRUNK_SHARE * this.trunk;
    return [Math.cos(tilt / 2), -Math.sin(tilt / 2), 0, 0];
  }

  /** Landmarks as an upright camera in the same place sees them. */
  upright({ world, picture, visible, hands }: Landmarks): Landmarks {
    const roll = this.roll ** 3 / (this.roll ** 2 + (SWAY * RADIANS) ** 2); // less if it is within people's sway
    const turn: Quaternion = [Math.cos(roll / 2), 0, 0, Math.sin(roll / 2)];
    return {
      world: world.map((place) => rotate(turn, place)),
      picture: picture.map(([x, y]) => rotate(turn, [x, y, 0]).slice(0, 2) as unknown as readonly [number, number]),
      visible,
      hands: hands && turnedHands(hands, turn),
    };
  }
}

function tiltOf([x, y, z]: Vector): number {
  return Math.atan2(z, Math.hypot(x, y));
}

/** Up the trunk of a sitting person, unless it leans too far. */
function trunkOf(landmarks: Landmarks): Vector | null {
  const shoulders = placesOf(landmarks, "shoulder");
  if (shoulders.visible < VISIBLE) return null;
  const up = subtract(shoulders.middle, placesOf(landmarks, "hip").middle);
  return up[1] <= 0 || Math.abs(tiltOf(up)) > STEEPEST * RADIANS ? null : up;
}

/** From feet to shoulders of a body that stands or walks. */
function upright(landmarks: Landmarks): Vector | null {
  const [shoulders, hips, knees, ankles] = (["shoulder", "hip", "knee", "ankle"] as const).map((part) =>
    placesOf(landmarks, part),
  );
  if (Math.min(...[shoulders, hips, knees, ankles].map(({ visible }) => visible)) < VISIBLE) return null;
  const up = unit(subtract(shoulders.middle, ankles.middle));
  const bones = [0, 1].flatMap((k) => [subtract(hips.both[k], knees.both[k]), subtract(knees.both[k], ankles.both[k])]);
  const trunk = scaled(add(subtract(shoulders.both[0], hips.both[0]), subtract(shoulders.both[1], hips.both[1])), 0.5);
  const straight = Math.min(...[...bones, trunk].map((bone) => dot(bone, up) / Math.max(size(bone), 1e-9)));
  const isLevel =
    Math.abs(tiltOf(up)) < STEEPEST * RADIANS && Math.abs(Math.atan2(up[0], up[1])) < MOST_ROLLED * RADIANS;
  return straight > Math.cos(UPRIGHT * RADIANS) && isLevel ? up : null;
}
