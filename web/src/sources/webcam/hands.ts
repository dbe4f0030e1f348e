/** Hands before a webcam: which is whose, and the points of their fingers (bodysense.devices.video). */

import {
  add,
  conjugate,
  cross,
  dot,
  fromAxes,
  mixed,
  multiply,
  rotate,
  scaled,
  size,
  subtract,
  unit,
} from "../../body/math";
import type { Quaternion, Vector } from "../../body/math";
import { restOf, type Skeleton } from "../../body/skeleton";
import type { Laid } from "./laid";
import { mark, type Landmarks, type Side } from "./landmark_marks";

/** A hand in the picture: MediaPipe's 21 landmarks, in the axes of `Landmarks`. */
export interface Hand {
  readonly world: readonly Vector[]; // m, from the middle of the hand
  readonly picture: readonly (readonly [number, number])[];
  readonly left: number; // probability that it is a left hand
}

export type Hands = Readonly<Partial<Record<Side, Hand | undefined>>>;

const FINGERS = ["thumb", "index", "middle", "ring", "pinky"] as const; // in the order of the landmarks, 4 each
const PARTS = ["1", "2", "3", "_tip"] as const;
const KNUCKLES = { index: 5, middle: 9, pinky: 17 } as const; // of the palm
const REACH = 0.4; // largest distance from an arm's wrist to that of its hand, in sizes of the person
const WRONG_SIDE = 0.25; // added for a hand that is certainly of the other side
const TWICE = 0.15; // of a hand's extent: two hands that are nearer are one, found twice

/** Return the hands at the wrists of a body: the most likely pair. */
export function handsOf({ picture }: Landmarks, found: readonly Hand[]): Hands {
  const flat = ([x, y]: readonly [number, number]): Vector => [x, y, 0];
  const apart = (a: readonly [number, number], b: readonly [number, number]): number =>
    size(subtract(flat(a), flat(b)));
  const middle = (part: "shoulder" | "hip"): Vector =>
    scaled(add(flat(picture[mark("left", part)]), flat(picture[mark("right", part)])), 0.5);
  const trunk = size(subtract(middle("shoulder"), middle("hip")));
  const width = apart(picture[mark("left", "shoulder")], picture[mark("right", "shoulder")]);
  const person = Math.max(trunk, 1.4 * width, 1e-3);
  const cost = (side: Side, hand: Hand | undefined): number => {
    if (!hand) return REACH + WRONG_SIDE; // worse than any hand that may be of this arm
    const away = apart(picture[mark(side, "wrist")], hand.picture[0]) / person;
    return away > REACH ? Infinity : away + WRONG_SIDE * (side === "left" ? 1 - hand.left : hand.left);
  };
  const isOne = (a: Hand, b: Hand): boolean => {
    const [across, up] = [0, 1].map((axis) => {
      const values = a.picture.map((place) => place[axis]);
      return Math.max(...values) - Math.min(...values);
    });
    const mean = a.picture.reduce((sum, place, k) => sum + apart(place, b.picture[k]), 0) / a.picture.length;
    return mean < TWICE * Math.hypot(across, up);
  };
  let best: { readonly hands: Hands; readonly cost: number } = { hands: {}, cost: Infinity };
  for (const left of [undefined, ...found])
    for (const right of [undefined, ...found]) {
      if (left && right && (left === right || isOne(left, right))) continue;
      const sum = cost("left", left) + cost("right", right);
      if (sum < best.cost) best = { hands: { left, right }, cost: sum };
    }
  return best.hands;
}

/** Smooth hands that were seen in the frame before. */
export function smoothedHands(before: Hands, now: Hands, share: number): Hands {
  const smooth = (side: Side): Hand | undefined => {
    const [old, hand] = [before[side], now[side]];
    return old && hand ? { ...hand, world: hand.world.map((point, k) => mixed(old.world[k], point, share)) } : hand;
  };
  return { left: smooth("left"), right: smooth("right") };
}

/** Turn the landmarks of hands in the world. */
export function turnedHands(hands: Hands, turn: Quaternion): Hands {
  const turned = (hand: Hand | undefined): Hand | undefined =>
    hand && { ...hand, world: hand.world.map((place) => rotate(turn, place)) };
  return { left: turned(hands.left), right: turned(hands.right) };
}

/** The names of the finger points of a side, in the order of the landmarks after the wrist. */
export function fingerPoints(side: Side): string[] {
  return FINGERS.flatMap((finger) => PARTS.map((part) => `${side}_${finger}${part}`));
}

/** Lay a hand at its wrist: the palm turned as its knuckles are, each finger along its landmarks with its own bones. */
export function layHand(side: Side, { world }: Hand, skeleton: Skeleton, laid: Laid): void {
  const rest = restOf(skeleton);
  const own = palm(rest(`${side}_wrist`), ...knuckles((finger) => rest(`${side}_${finger}1`)));
  const turn = multiply(palm(world[0], ...knuckles((finger) => world[KNUCKLES[finger]])), conjugate(own));
  laid.rotation.set(`${side}_wrist`, turn);
  const visible = laid.visible(`${side}_wrist`);
  const names = fingerPoints(side);
  for (let finger = 0; finger < FINGERS.length; finger++)
    for (let part = 0; part < PARTS.length; part++) {
      const k = PARTS.length * finger + part;
      const above = part === 0 ? `${side}_wrist` : names[k - 1];
      const bone = subtract(rest(names[k]), rest(above));
      const along = subtract(world[k + 1], world[k]);
      // The palm is rigid: its own shape is better than that of landmarks.
      const laidBone = part === 0 || size(along) < 1e-4 ? rotate(turn, bone) : scaled(unit(along), size(bone));
      laid.put(names[k], add(laid.at(above), laidBone), visible);
    }
}

function knuckles(at: (finger: keyof typeof KNUCKLES) => Vector): [Vector, Vector, Vector] {
  return [at("index"), at("middle"), at("pinky")];
}

/** The axes of a palm: from the wrist to the knuckles, across the knuckles, its normal. */
function palm(wrist: Vector, index: Vector, middle: Vector, pinky: Vector): Quaternion {
  const ahead = unit(subtract(scaled(add(add(index, middle), pinky), 1 / 3), wrist));
  const across = subtract(index, pinky);
  const aside = unit(subtract(across, scaled(ahead, dot(across, ahead))));
  return fromAxes(ahead, aside, cross(ahead, aside));
}
