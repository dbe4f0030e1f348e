/** A webcam: placeholder until landmarks become points. */

import type { Skeleton } from "../core/skeleton";
import type { About } from "../offline";
import type { Sink, Source } from "./source";

export async function openWebcam(about: About, _base: string, _sink: Sink, _skeleton: Skeleton, _fault: (text: string) => void): Promise<Source> {
  throw new Error(about.webcam ? "not yet" : "no webcam");
}
