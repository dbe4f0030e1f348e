/** Sitting and standing before a camera, and the legs of either (bodysense.devices.video.sitting). */

import { add, conjugate, cross, dot, fromAxes, rotate, scaled, size, subtract, unit } from "../../body/math";
import type { Quaternion, Vector } from "../../body/math";
import { restOf, type Skeleton } from "../../body/skeleton";
import {
  ANKLE_VISIBLE,
  APART,
  ASSUMED,
  CUE_HALF_LIFE,
  CUE_RANGE,
  DROPS,
  DROP_BIAS,
  DROP_DEVIATION,
  HIP_OVER_SEAT,
  KNEE_VISIBLE,
  LONGEST_CUE,
  LOWEST,
  MARGIN,
  ON_TABLE,
  PITCH,
  SEAT,
  SEATED,
  SEAT_DEVIATION,
  SHORT,
  STANDING,
  STRAIGHT_BEND,
  TRUE_BEND,
  USUAL,
  WIDEST,
} from "./constants";
import type { Laid } from "./laid";
import { mark, placesOf, SIDES, type Landmarks, type Part, type Side } from "./landmark_marks";

const UP: Vector = [0, 1, 0];

const within = (value: number, [least, most]: readonly [number, number]): number =>
  Math.min(Math.max(value, least), most);

/** Evidence of the posture in the frames so far. */
export class Sitting {
  isSeated = true; // people whose legs were never seen sit at a desk
  private cues: number | null = null;
  private time = -Infinity; // s, of the last frame with knees

  /** Add a frame of unprocessed landmarks at `time` s; nothing changes if no knees are seen. */
  step(landmarks: Landmarks, time: number): void {
    if (placesOf(landmarks, "knee").visible < KNEE_VISIBLE) return;
    const cues = cuesOf(landmarks);
    const isFirst = this.cues === null;
    const share = isFirst ? 1 : 1 - 2 ** (-Math.min(time - this.time, LONGEST_CUE) / CUE_HALF_LIFE);
    this.cues = (this.cues ?? cues) + share * (cues - (this.cues ?? cues));
    this.isSeated = this.cues > SEATED + (isFirst ? 0 : this.isSeated ? -MARGIN : MARGIN);
    this.time = time;
  }
}

const LEGS = (["knee", "ankle", "heel", "toe"] as const).flatMap((part) => SIDES.map((side) => mark(side, part)));

/** Landmarks whose legs are not seen beyond the lower edge of the picture, where landmarkers guess that they hang. */
export function withoutGuessedLegs(landmarks: Landmarks): Landmarks {
  const visible = [...landmarks.visible];
  for (const place of LEGS) if (landmarks.picture[place][1] < LOWEST) visible[place] = 0;
  return { ...landmarks, visible };
}

function cuesOf(landmarks: Landmarks): number {
  const [hip, knee, ankle] = (["hip", "knee", "ankle"] as const).map((part) => placesOf(landmarks, part));
  const flat = (part: Part): Vector[] =>
    SIDES.map((side): Vector => [...landmarks.picture[mark(side, part)], 0] as unknown as Vector);
  const across = unit(subtract(hip.both[0], hip.both[1]));
  const thigh = subtract(knee.middle, hip.middle);
  const pitch = (Math.atan2(dot(thigh, [-across[2], 0, across[0]]), -thigh[1]) * 180) / Math.PI;
  const frontal = within(2 * Math.abs(across[0]) - 1, [0, 1]); // widths tell nothing of a person from the side
  const [hips, knees, ankles] = (["hip", "knee", "ankle"] as const).map(flat);
  const width = size(subtract(knees[0], knees[1])) / Math.max(size(subtract(hips[0], hips[1])), 1e-3);
  const length = (from: readonly Vector[], to: readonly Vector[]): number =>
    (size(subtract(from[0], to[0])) + size(subtract(from[1], to[1]))) / 2;
  const seen = cue(pitch, PITCH) + frontal * cue(width, APART);
  return ankle.visible < ANKLE_VISIBLE
    ? seen
    : seen + cue(length(hips, knees) / Math.max(length(knees, ankles), 1e-3), SHORT);
}

function cue(value: number, [middle, spread]: readonly [number, number]): number {
  return within((value - middle) / spread, CUE_RANGE);
}

/** Where a body is: the pelvis in an upright camera's axes, the camera's lens, and the floor over the camera, m. */
export interface Standpoint {
  readonly place: Vector;
  readonly focal: number;
  readonly room: Quaternion; // room ← upright camera
  readonly floor: number | null;
}

/** Lay the legs of the posture. */
export function layLegs(laid: Laid, seen: Landmarks, at: Standpoint, skeleton: Skeleton, isSeated: boolean): void {
  const isSeen = placesOf(seen, "knee").visible >= KNEE_VISIBLE;
  const { place, room, floor } = at;
  const sits =
    !isSeen && floor !== null ? rotate(room, place)[1] - floor < STANDING * skeleton.restOffset[1] : isSeated;
  if (sits) sit(laid, seen, at, skeleton, isSeen);
  else stand(laid, seen, room, skeleton);
  for (const part of ["knee", "ankle"])
    if (SIDES.every((side) => laid.visible(`${side}_${part}`) < ASSUMED))
      for (const side of SIDES) laid.put(`${side}_${part}`, laid.at(`${side}_${part}`), ASSUMED);
}

function sit(laid: Laid, seen: Landmarks, at: Standpoint, skeleton: Skeleton, isSeen: boolean): void {
  const { place, room, floor } = at;
  const rest = restOf(skeleton);
  const across = subtract(laid.at("left_hip"), laid.at("right_hip"));
  const [x, , z] = rotate(room, [-across[2], 0, across[0]]);
  const ahead = unit([x, 0, z]);
  const thighs = SIDES.map((side) => (isSeen ? thighOf(side, laid, seen, at, skeleton, ahead) : ahead));
  const length = size(subtract(rest("left_knee"), rest("left_hip")));
  const over = skeleton.restOffset[1] + (rest("left_knee")[1] + rest("right_knee")[1]) / 2; // m, knees over the floor
  const usual = SEAT + HIP_OVER_SEAT - over;
  const hips = scaled(add(laid.at("left_hip"), laid.at("right_hip")), 0.5);
  let drop = usual;
  if (isSeen) {
    const found = (-length * (thighs[0][1] + thighs[1][1])) / 2 - DROP_BIAS;
    const isCrouch = placesOf(seen, "ankle").visible >= ANKLE_VISIBLE; // the feet are in the picture
    const sure = (found < usual - USUAL && !isCrouch ? ON_TABLE : 1) / DROP_DEVIATION ** 2;
    const trust = (isCrouch ? Math.exp(-0.5 * ((found - usual) / USUAL) ** 2) : 1) / SEAT_DEVIATION ** 2;
    drop = (found * sure + usual * trust) / (sure + trust);
  } else if (floor !== null) drop = rotate(room, add(place, hips))[1] - floor - over;
  drop = within(drop, DROPS);
  const toCamera = conjugate(room);
  SIDES.forEach((side, k) => {
    const flat = unit([thighs[k][0], 0, thighs[k][2]]);
    const [hip, knee] = [`${side}_hip`, `${side}_knee`];
    const bone = add(scaled(flat, length * Math.sqrt(1 - (drop / length) ** 2)), [0, -drop, 0]);
    const turned = fromAxes(cross(UP, flat), UP, flat); // feet ahead of the knees
    laid.put(knee, add(laid.at(hip), rotate(toCamera, bone)), laid.visible(knee));
    for (const point of ["ankle", "foot", "toe"].map((part) => `${side}_${part}`)) {
      const below = rotate(toCamera, rotate(turned, subtract(rest(point), rest(knee))));
      laid.put(point, add(laid.at(knee), below), laid.visible(point));
    }
  });
}

/** The direction of a thigh in the room: its knee is on a ray through the picture, and ahead. */
function thighOf(
  side: Side,
  laid: Laid,
  seen: Landmarks,
  { place, focal, room }: Standpoint,
  skeleton: Skeleton,
  ahead: Vector,
): Vector {
  const rest = restOf(skeleton);
  const length = size(subtract(rest(`${side}_knee`), rest(`${side}_hip`)));
  const [u, v] = seen.picture[mark(side, "knee")];
  const ray = unit([u, v, -focal]);
  const start = add(place, laid.at(`${side}_hip`));
  const middle = dot(ray, start);
  const depth = Math.sqrt(Math.max(middle ** 2 - dot(start, start) + length ** 2, 0));
  const ends = [-1, 1].map((sign) => rotate(room, subtract(scaled(ray, middle + sign * depth), start)));
  const thigh = unit(dot(ends[0], ahead) >= dot(ends[1], ahead) ? ends[0] : ends[1]);
  const aside = cross(UP, ahead);
  const wide = within(dot(thigh, aside), [-WIDEST, WIDEST]);
  const [x, , z] = add(scaled(aside, wide), scaled(ahead, Math.sqrt(1 - wide ** 2)));
  return [x, thigh[1], z];
}

/** Knees lose the bend that landmarks of straight legs have; hidden shins hang. */
function stand(laid: Laid, seen: Landmarks, room: Quaternion, skeleton: Skeleton): void {
  const rest = restOf(skeleton);
  for (const side of SIDES) {
    const [hip, knee, ankle] = ["hip", "knee", "ankle"].map((part) => `${side}_${part}`);
    const thigh = subtract(laid.at(knee), laid.at(hip));
    const isHidden = seen.visible[mark(side, "ankle")] < ANKLE_VISIBLE;
    const shin = isHidden
      ? rotate(conjugate(room), subtract(rest(ankle), rest(knee)))
      : subtract(laid.at(ankle), laid.at(knee));
    const bend = (Math.acos(within(dot(unit(thigh), unit(shin)), [-1, 1])) * 180) / Math.PI;
    const share =
      bend >= TRUE_BEND
        ? 1
        : (Math.max(bend - STRAIGHT_BEND, 0) * TRUE_BEND) / (TRUE_BEND - STRAIGHT_BEND) / Math.max(bend, 1e-6);
    const chord = unit(isHidden ? shin : add(thigh, shin));
    const laidOut = (bone: Vector): Vector =>
      scaled(unit(add(scaled(chord, (1 - share) * size(bone)), scaled(bone, share))), size(bone));
    const before = laid.at(ankle);
    laid.put(knee, add(laid.at(hip), laidOut(thigh)), laid.visible(knee));
    const moved = subtract(add(laid.at(knee), laidOut(shin)), before);
    for (const point of ["ankle", "foot", "toe"].map((part) => `${side}_${part}`))
      laid.put(point, add(laid.at(point), moved), laid.visible(point));
  }
}
