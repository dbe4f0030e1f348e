/** Motion of the camera after a body. */

const RATE = 2.5; // per s: how fast the camera goes after somebody who walks

/** The part of a distance, m, that the camera moves by within `seconds`; the same however many pictures are drawn. */
export function followed(distance: number, seconds: number): number {
  return distance * (1 - Math.exp(-RATE * Math.max(seconds, 0)));
}
