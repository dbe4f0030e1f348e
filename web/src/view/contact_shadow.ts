/** Contact shadows: soft spots on the floor below feet and hips, on devices that are too slow for cast shadows. */

import { DataTexture, Group, LinearFilter, Mesh, MeshBasicMaterial, PlaneGeometry } from "three";
import type { Body } from "../body/skeleton";

/** A spot below the middle of two points. */
interface Spot {
  readonly points: readonly [string, string];
  readonly width: number; // m
  readonly length: number; // m, along the line between the points
  readonly darkness: number; // 0 to 1, of a spot whose points are on the floor
  readonly reach: number; // m above the floor at which it has faded
}

const SPOTS: readonly Spot[] = [
  { points: ["left_ankle", "left_toe"], width: 0.26, length: 0.46, darkness: 0.6, reach: 0.5 },
  { points: ["right_ankle", "right_toe"], width: 0.26, length: 0.46, darkness: 0.6, reach: 0.5 },
  { points: ["left_hip", "right_hip"], width: 0.9, length: 0.9, darkness: 0.35, reach: 2.5 },
];
const SIZE = 32; // pixels of the texture
export const CONTACT_SHADOWS = 3; // layer: cameras that see it draw contact shadows

export class ContactShadow {
  readonly group = new Group();
  readonly spots: readonly Mesh<PlaneGeometry, MeshBasicMaterial>[];

  constructor() {
    const shape = new PlaneGeometry().rotateX(-Math.PI / 2);
    const map = softTexture();
    this.spots = SPOTS.map(({ width, length }) => {
      const look = { map, color: "#000000", transparent: true, depthWrite: false, toneMapped: false, fog: false };
      const spot = new Mesh(shape, new MeshBasicMaterial(look));
      spot.scale.set(width, 1, length);
      spot.renderOrder = -1; // after the floor
      spot.layers.set(CONTACT_SHADOWS);
      return spot;
    });
    this.group.add(...this.spots);
  }

  /** Put the spots below a body whose points have these names; the floor is y = 0. */
  show({ position }: Body, names: readonly string[]): void {
    SPOTS.forEach(({ points, darkness, reach }, k) => {
      const [from, to] = points.map((name) => 3 * names.indexOf(name));
      const [dx, dz] = [position[to] - position[from], position[to + 2] - position[from + 2]];
      const height = Math.max(Math.min(position[from + 1], position[to + 1]), 0);
      const spot = this.spots[k];
      spot.position.set(position[from] + dx / 2, 0, position[from + 2] + dz / 2);
      spot.rotation.y = Math.atan2(dx, dz);
      spot.material.opacity = darkness * Math.max(1 - height / reach, 0);
    });
  }
}

/** White, and fading to transparent at the rim. */
function softTexture(): DataTexture {
  const pixels = new Uint8Array(4 * SIZE * SIZE).fill(255);
  for (let k = 0; k < SIZE * SIZE; k++) {
    const [x, y] = [k % SIZE, Math.floor(k / SIZE)].map((place) => (2 * (place + 0.5)) / SIZE - 1);
    pixels[4 * k + 3] = 255 * Math.max(1 - x * x - y * y, 0) ** 2;
  }
  const texture = new DataTexture(pixels, SIZE, SIZE);
  [texture.magFilter, texture.needsUpdate] = [LinearFilter, true];
  return texture;
}
