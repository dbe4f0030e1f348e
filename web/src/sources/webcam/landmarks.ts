/** A person's landmarks in a picture as points of the body (bodysense.devices.video.landmark_points).
 *
 * Landmarks come from a picture: their directions are reliable, their lengths are not. Each limb is laid along its
 * landmarks with the body's own bones, from the pelvis outward. The body's position follows from its place in the picture.
 */

import { Matrix3, Vector3 } from "three";
import {
  add,
  conjugate,
  cross,
  dot,
  fromAxes,
  multiply,
  rotate,
  scaled,
  size,
  subtract,
  unit,
  type Quaternion,
  type Vector,
} from "../../body/math";
import { ACCURACY, type Point } from "../../body/observation";
import { restOf, type Skeleton } from "../../body/skeleton";
import { CameraLevel } from "./camera_level";
import { fingerPoints, layHand } from "./hands";
import { Laid } from "./laid";
import { FEET_VISIBLE, FLOOR_HALF_LIFE, NEAR, UNSEEN_LEGS, VISIBLE } from "./constants";
import { mark, MARKS, SIDES, type Landmarks, type Part, type Side } from "./landmark_marks";
import { layLegs, Sitting, withoutGuessedLegs } from "./sitting";

const PULL = { shoulder: 1, hip: 1, elbow: 0.3, wrist: 0.3, knee: 0.3, ankle: 0.3 } as const; // weights of landmarks
// that place the body: directions of limbs are less sure than the trunk's
const TRUNK = { shoulder: 1, hip: 1 } as const; // the same before legs are known
const FOLLOWED = 0.1; // s: half-life of the smoothing of the place
const LIMBS = [
  ["shoulder", "elbow"],
  ["elbow", "wrist"],
  ["hip", "knee"],
  ["knee", "ankle"],
  ["ankle", "toe"],
] as const;

/** Points of the body in the room: the camera's axes without its tilt and roll, the lowest foot on the floor, z 0 where
 * the person was first seen.
 *
 * The picture alone gives places in units of the body, whose height the tracker infers only later: metres follow from
 * the proportions of the moment.
 */
export class LandmarkPoints {
  private begun: number | null = null; // z of the first view of the person, in pelvis heights
  private floor: number | null = null; // the floor's height over the camera's, in pelvis heights
  private readonly place = new SteadyPlace(); // of the pelvis before the camera, in its height at rest
  private readonly level = new CameraLevel();
  private readonly sitting = new Sitting();

  constructor(private readonly focal: number) {} // in heights of the picture

  /** Null if no torso is seen. `smooth` are the landmarks smoothed, `passed`: s since the frame before. */
  read(raw: Landmarks, smooth: Landmarks, skeleton: Skeleton, passed: number, time: number): Point[] | null {
    const [landmarks, calm] = [raw, smooth].map(withoutGuessedLegs);
    if (SIDES.some((side) => calm.visible[mark(side, "shoulder")] < VISIBLE)) return null;
    this.sitting.step(landmarks, time);
    this.level.step(landmarks, time, this.sitting.isSeated);
    const [seen, now, { room }] = [this.level.upright(calm), this.level.upright(landmarks), this.level];
    const laid = lay(seen, skeleton);
    const up = skeleton.restOffset[1]; // m: height of the pelvis at rest
    const trunk = located(laid, now, this.focal, TRUNK);
    const floor = this.floor === null ? null : up * this.floor;
    layLegs(laid, seen, { place: trunk, focal: this.focal, room, floor }, skeleton, this.sitting.isSeated);
    const place = this.place.follow(scaled(located(laid, now, this.focal, PULL), 1 / up), passed);
    const [x, y, z] = rotate(room, place);
    this.begun ??= z;
    const height = standingHeight(laid, room, skeleton);
    this.learnFloor(y - height / up, seen.visible, passed);
    return pointsOf(laid, calm, room, [up * x, height, up * (z - this.begun)]);
  }

  private learnFloor(floor: number, visible: readonly number[], passed: number): void {
    const parts: readonly Part[] = this.sitting.isSeated ? ["knee", "ankle"] : ["knee"]; // shins of standing people hang
    const legs = SIDES.flatMap((side) => parts.map((part) => visible[mark(side, part)]));
    if (Math.min(...legs) < FEET_VISIBLE) return;
    this.floor =
      this.floor === null ? floor : this.floor + (1 - 2 ** (-passed / FLOOR_HALF_LIFE)) * (floor - this.floor);
  }
}

/** A smoothed place that is not behind one that moves steadily: place and velocity, critically damped. */
class SteadyPlace {
  private place: Vector | null = null;
  private velocity: Vector = [0, 0, 0]; // per s

  follow(seen: Vector, passed: number): Vector {
    if (!this.place || passed <= 0) return (this.place ??= seen);
    const kept = 2 ** (-passed / FOLLOWED);
    const expected = add(this.place, scaled(this.velocity, passed));
    const missed = subtract(seen, expected);
    this.velocity = add(this.velocity, scaled(missed, (1 - kept) ** 2 / passed));
    return (this.place = add(expected, scaled(missed, 1 - kept ** 2)));
  }
}

/** How high the pelvis is over the floor, m, if the lower foot is on it. */
function standingHeight(laid: Laid, room: Quaternion, skeleton: Skeleton): number {
  const rest = restOf(skeleton);
  // By the ankles alone: how far toes point down is the least sure of all, and would lift the whole body.
  const heights = SIDES.map(
    (side) => rotate(room, laid.at(`${side}_ankle`))[1] - rest(`${side}_ankle`)[1] - skeleton.restOffset[1],
  );
  return -Math.min(...heights);
}

function pointsOf(laid: Laid, { visible }: Landmarks, room: Quaternion, root: Vector): Point[] {
  const parts = (names: readonly string[]) => SIDES.flatMap((side) => names.map((part) => `${side}_${part}`));
  const legs = parts(["knee", "ankle", "foot", "toe"]);
  const isHidden = (part: Part): boolean => SIDES.every((side) => visible[mark(side, part)] < VISIBLE);
  const [knees, ankles] = [isHidden("knee"), isHidden("ankle")];
  const errorOf = (name: string): number => {
    const isAssumed = (knees && ankles) || (knees && name.endsWith("knee")) || (ankles && name.endsWith("ankle"));
    return ACCURACY.landmark * (isAssumed ? UNSEEN_LEGS : 1);
  };
  const turned = (name: string): Quaternion | null => {
    const rotation = laid.rotation.get(name);
    return rotation ? multiply(room, rotation) : null;
  };
  const fingers = SIDES.flatMap(fingerPoints); // visible where hands were found
  const points = ["head", ...parts(["shoulder", "elbow", "wrist"]), ...legs, ...fingers]
    .filter((name) => laid.visible(name) >= VISIBLE)
    .map((name) => ({
      name,
      position: add(rotate(room, laid.at(name)), root),
      rotation: turned(name),
      accuracy: errorOf(name) / laid.visible(name),
    }));
  return [...points, { name: "spine3", position: null, rotation: turned("spine3"), accuracy: errorOf("spine3") }];
}

function lay({ world, visible: seen, hands }: Landmarks, skeleton: Skeleton): Laid {
  const [laid, rest] = [new Laid(), restOf(skeleton)];
  const both = (part: Part) => SIDES.map((side) => world[mark(side, part)]);
  const middle = ([a, b]: readonly Vector[]): Vector => scaled(add(a, b), 0.5);
  const [shoulders, hips] = [both("shoulder"), both("hip")];
  const spine = subtract(middle(shoulders), middle(hips));
  const pelvis = frame(subtract(hips[0], hips[1]), spine);
  const chest = frame(subtract(shoulders[0], shoulders[1]), spine);
  const ears = [world[MARKS.left_ear], world[MARKS.right_ear]];
  const across = subtract(ears[0], ears[1]);
  const ahead = subtract(world[MARKS.nose], middle(ears));
  const head = frame(across, cross(ahead, across));
  laid.rotation.set("spine3", chest).set("head", head);
  const neck = subtract(rest("head"), rest("neck"));
  laid.put(
    "head",
    add(rotate(chest, rest("neck")), scaled(add(rotate(chest, neck), rotate(head, neck)), 0.5)),
    Math.min(seen[MARKS.left_ear], seen[MARKS.right_ear], ...SIDES.map((side) => seen[mark(side, "shoulder")])),
  );
  const [hx, , hz] = rotate(pelvis, [1, 0, 0]);
  const heading = frame([hx, 0, hz], [0, 1, 0]);
  for (const side of SIDES) {
    laid.put(`${side}_hip`, rotate(pelvis, rest(`${side}_hip`)), seen[mark(side, "hip")]);
    laid.put(`${side}_shoulder`, rotate(chest, rest(`${side}_shoulder`)), seen[mark(side, "shoulder")]);
    for (const [start, end] of LIMBS) {
      const [first, last] = [`${side}_${start}`, `${side}_${end}`];
      const bone = subtract(rest(last), rest(first));
      const isSeen = Math.min(seen[mark(side, start)], seen[mark(side, end)]) >= VISIBLE;
      const isArm = start === "shoulder" || start === "elbow";
      const direction = subtract(world[mark(side, end)], world[mark(side, start)]);
      const along = isSeen || isArm ? scaled(unit(direction), size(bone)) : rotate(heading, bone); // hidden legs stand straight
      laid.put(last, add(laid.at(first), along), Math.min(laid.visible(first), seen[mark(side, end)]));
    }
    layBall(side, rest, laid);
    const [hand, fingers] = [handOf(side, world), hands?.[side]];
    if (fingers) layHand(side, fingers, skeleton, laid);
    else if (Math.min(seen[mark(side, "wrist")], seen[mark(side, "index")]) >= VISIBLE && hand)
      laid.rotation.set(`${side}_wrist`, hand);
  }
  return laid;
}

/** Lay the ball of a foot, between its ankle and its toes. */
function layBall(side: string, rest: (name: string) => Vector, laid: Laid): void {
  const [knee, ankle, toe, foot] = ["knee", "ankle", "toe", "foot"].map((part) => `${side}_${part}`);
  const footOf = (at: (name: string) => Vector): Quaternion =>
    frame(subtract(at(toe), at(ankle)), subtract(at(knee), at(ankle)));
  const own = rotate(conjugate(footOf(rest)), subtract(rest(foot), rest(ankle)));
  const turn = footOf((name) => laid.at(name));
  laid.put(foot, add(laid.at(ankle), rotate(turn, own)), laid.visible(toe));
}

/** A hand's turn from the knuckles of index and little finger: fingers along ±X, the thumb's side along +Z. */
function handOf(side: Side, world: readonly Vector[]): Quaternion | null {
  const [wrist, index, pinky] = [world[mark(side, "wrist")], world[mark(side, "index")], world[mark(side, "pinky")]];
  const along = subtract(scaled(add(index, pinky), 0.5), wrist);
  const across = subtract(index, pinky);
  if (size(along) < 0.01 || size(across) < 0.005) return null;
  const x = scaled(unit(along), side === "left" ? 1 : -1);
  const y = unit(cross(across, x));
  return fromAxes(x, y, cross(x, y));
}

/** Fit the pelvis position in the camera's axes so that joints project onto the landmarks (least squares). */
function located(
  laid: Laid,
  { picture, visible }: Landmarks,
  focal: number,
  pulls: Readonly<Partial<Record<Part, number>>>,
): Vector {
  const normal = new Matrix3(0, 0, 0, 0, 0, 0, 0, 0, 0);
  const right = new Vector3();
  const addRow = (row: Vector, value: number, pull: number): void => {
    right.addScaledVector(new Vector3(...row), pull * pull * value);
    for (let k = 0; k < 9; k++) normal.elements[k] += pull * pull * row[k % 3] * row[Math.floor(k / 3)];
  };
  for (const side of SIDES) {
    for (const part of Object.keys(pulls) as Part[]) {
      const q = laid.at(`${side}_${part}`);
      const [u, v] = picture[mark(side, part)];
      const pull = (pulls[part] ?? 0) * Math.min(Math.max(visible[mark(side, part)], 0.05), 1);
      addRow([focal, 0, -u], -focal * q[0] - u * q[2], pull);
      addRow([0, focal, -v], -focal * q[1] - v * q[2], pull);
    }
  }
  const { x, y, z: depth } = right.applyMatrix3(normal.invert());
  return [x, y, -Math.max(depth, NEAR)];
}

/** The rotation whose x is along `across` and whose y is nearest to `up`. */
function frame(across: Vector, up: Vector): Quaternion {
  const x = unit(across);
  const y = unit(subtract(up, scaled(x, dot(up, x))));
  return fromAxes(x, y, cross(x, y));
}
