/** A box under a seated body. */

import { Group, Mesh, MeshStandardMaterial } from "three";
import { RoundedBoxGeometry } from "three/addons/geometries/RoundedBoxGeometry.js";
import type { Body, Skeleton } from "../body/skeleton";

const LOWERED = 0.87; // of the pelvis's standing height: higher ones stand
const LEAST = 0.15; // m, height of a seat: lower ones sit on the floor
const BEHIND = 0.2; // m from the feet's middle to the pelvis: nearer ones are carried by the feet, as in a squat
const BELOW = 0.095; // m from the hips down to the seat
const FLOORED = 0.25; // m: a higher foot is not on the floor: the body steps
const SETTLED = 0.4; // s of sitting before the box is there
const MOVED = 0.15; // m by which the hips leave their place before the box follows
const SIZE = 0.42; // m, width and depth
const SHINS = 0.07; // m from the ankles back to the front of the box, which does not cut them
const FARTHEST_BACK = 0.19; // m by which the box gives way to shins; its front stays under the hips
const RESTED = 2; // s in which hips that keep their place sit, also over their feet: a squat is not held as long
const STILL = 0.1; // m/s: resting hips are slower
const CHAIR = 0.3; // m, height of a seat that resting hips are on: lower ones squat

/** A place to sit on, m, and the direction that it faces, rad about +Y. */
export interface Place {
  readonly at: readonly [number, number, number]; // middle of its top
  readonly turn: number;
}

/** Return the seat under a body, or null if it is not low, or if its feet are nearer than `behind` m and carry it. */
export function seatUnder({ position }: Body, tree: Skeleton, behind = BEHIND): Place | null {
  const point = (name: string): readonly [number, number, number] => {
    const at = 3 * tree.points.indexOf(name);
    return [position[at], position[at + 1], position[at + 2]];
  };
  const [left, right, a, b] = ["left_hip", "right_hip", "left_ankle", "right_ankle"].map(point);
  const [x, y, z] = [0, 1, 2].map((k) => (left[k] + right[k]) / 2);
  const top = y - BELOW;
  const [dx, dz] = [(a[0] + b[0]) / 2 - x, (a[2] + b[2]) / 2 - z];
  if (point("pelvis")[1] > LOWERED * tree.restOffset[1] || top < LEAST || Math.hypot(dx, dz) < behind) return null;
  if (Math.max(a[1], b[1]) > FLOORED + top || Math.min(a[1], b[1]) > FLOORED) return null;
  const turn = Math.atan2(right[2] - left[2], left[0] - right[0]);
  const [ahead, aside] = [Math.cos(turn), Math.sin(turn)]; // along +Z and +X
  const back = Math.min(Math.max(SIZE / 2 + SHINS - (dx * aside + dz * ahead), 0), FARTHEST_BACK);
  return { at: [x - back * aside, top, z - back * ahead], turn };
}

export class Seat {
  readonly group = new Group();
  private readonly box = new Mesh(
    new RoundedBoxGeometry(SIZE, 1, SIZE, 3, 0.02),
    new MeshStandardMaterial({ color: "#b9b3a5", roughness: 0.8 }),
  );
  private place: Place | null = null;
  private sat = 0; // s
  private low: Place | null = null; // of the hips, averaged over a second
  private rested = 0; // s

  constructor() {
    this.box.castShadow = this.box.receiveShadow = true;
    this.group.add(this.box);
    this.group.visible = false;
  }

  /** Stand under the body if it sits; `seconds` have passed since the body before. */
  show(body: Body, tree: Skeleton, seconds: number): void {
    const found = this.resting(seatUnder(body, tree, 0), seconds) ?? seatUnder(body, tree);
    this.sat = found ? this.sat + seconds : 0;
    if (!found || this.sat < SETTLED) this.place = null;
    else if (!this.place || distance(this.place, found) > MOVED) this.place = found;
    this.group.visible = this.place !== null;
    if (!this.place) return;
    const [x, top, z] = this.place.at;
    this.box.scale.y = top;
    this.group.position.set(x, top / 2, z);
    this.group.rotation.y = this.place.turn;
  }

  /** Return the place of low hips if they have kept it. */
  private resting(low: Place | null, seconds: number): Place | null {
    const stays = low !== null && this.low !== null && distance(this.low, low) < STILL;
    this.rested = stays ? this.rested + seconds : 0;
    if (low && stays) {
      const { at } = this.low ?? low;
      const [x, y, z] = at.map((value, k) => value + (low.at[k] - value) * Math.min(seconds, 1));
      this.low = { ...low, at: [x, y, z] };
    } else this.low = low;
    return low && low.at[1] >= CHAIR && this.rested >= RESTED ? low : null;
  }
}

function distance({ at: [a, b, c] }: Place, { at: [x, y, z] }: Place): number {
  return Math.hypot(x - a, y - b, z - c);
}
