/** The first picture: the files it needs, and timing marks of it. */

import type { Clip } from "./body/clip";
import { readNpz } from "./files/npz";
import type { Skeleton } from "./body/skeleton";
import { defaultSkeleton, fetched, readJson } from "./engine/files";
import { amassClip } from "./files/amass";
import type { Moment } from "./takes/history";
import type { About } from "./offline";

const PERFORMANCE = "performance.npz";
const MOVING = 2; // pictures of different moments

export interface FirstFiles {
  readonly skeleton: Skeleton;
  readonly about: About;
  readonly performance: Clip;
}

export async function firstFiles(base: string): Promise<FirstFiles> {
  const [about, skeleton, arrays] = await Promise.all([
    readJson<About>(base, "page.json"),
    defaultSkeleton(base),
    fetched(base, PERFORMANCE).then(readNpz),
  ]);
  return { about, skeleton, performance: amassClip(arrays, "performance", skeleton) };
}

/** Sets performance marks when pictures of different moments were drawn and when the first completed body was drawn.
 * Calls `completed` once after that, so that work begun there delays neither.
 */
export class FirstPicture {
  private last: Moment | null = null;
  private drawn = 0;
  private state: "waiting" | "drawn" | "over" = "waiting"; // of the first completed body

  constructor(private readonly completed: () => void) {}

  /** Whether pictures of different moments were drawn. */
  get isMoving(): boolean {
    return this.drawn > MOVING;
  }

  /** Before a picture of a moment is drawn. */
  draw(moment: Moment): void {
    if (!this.isMoving) {
      if (this.drawn === MOVING) performance.mark("moving");
      if (this.drawn === MOVING || moment !== this.last) this.drawn += 1;
      this.last = moment;
    }
    if (this.state === "drawn" && this.isMoving) {
      performance.mark("completed");
      this.state = "over";
      this.completed();
    } else if (this.state === "waiting" && moment.expected) this.state = "drawn";
  }
}
