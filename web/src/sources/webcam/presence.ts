/** Presence of a person before a camera; single pictures without a person do not count. */

const LOST = { pictures: 3, seconds: 1.5 } as const; // without a person, both must pass until the person counts as gone

export class Presence {
  isThere = false;
  private missed = 0; // pictures since the last one with a person
  private last = 0; // ms, of that one

  /** Return whether a person is present, given whether the last picture shows one. */
  look(isSeen: boolean, milliseconds: number): boolean {
    if (isSeen) {
      this.isThere = true;
      this.missed = 0;
      this.last = milliseconds;
    } else {
      this.missed += 1;
      if (this.missed >= LOST.pictures && milliseconds - this.last > 1000 * LOST.seconds) this.isThere = false;
    }
    return this.isThere;
  }
}
