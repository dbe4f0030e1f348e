/** The first picture: what it needs, and when it moves. */

import type { Clip } from "./body/clip";
import { readNpz } from "./files/npz";
import { defaultBody, fetched, type DefaultBody } from "./engine/files";
import { amassClip } from "./files/amass";
import type { Moment } from "./history";
import { aboutPage, type About } from "./offline";

const PERFORMANCE = "performance.npz";
const MOVING = 2; // pictures of different moments

export interface FirstFiles {
  readonly body: DefaultBody;
  readonly about: About;
  readonly performance: Clip | null; // null where a server has something to show
}

export async function firstFiles(base: string): Promise<FirstFiles> {
  const about = aboutPage(base);
  const packed = about.then(({ server }) => (server ? null : fetched(base, PERFORMANCE)));
  const [body, bytes] = await Promise.all([defaultBody(base), packed]);
  return { body, about: await about, performance: bytes && (await performanceOf(bytes, body)) };
}

/** The packaged performance. */
export async function openPerformance(base: string, body: DefaultBody): Promise<Clip> {
  return performanceOf(await fetched(base, PERFORMANCE), body);
}

async function performanceOf(bytes: ArrayBuffer, { skeleton }: DefaultBody): Promise<Clip> {
  return amassClip(await readNpz(bytes), "performance", skeleton);
}

/** Calls `moving` once, when pictures of different moments were drawn; marked for who measures it. */
export class FirstPicture {
  private last: Moment | null = null;
  private drawn = 0;

  constructor(private readonly moving: () => void) {}

  /** Before a picture of a moment is drawn. */
  draw(moment: Moment): void {
    if (this.drawn > MOVING) return;
    if (this.drawn === MOVING) {
      performance.mark("moving");
      this.moving();
    }
    if (this.drawn === MOVING || moment !== this.last) this.drawn += 1;
    this.last = moment;
  }
}
