/** Downloads: what the timeline holds, as BVH or glTF. */

import { bvhText } from "./bvh";
import type { History } from "./history";
import { resample } from "./resample";

export type FileKind = "bvh" | "glb";

/** Throws an Error of one line while there is nothing to save. */
export async function saveMotion(history: History | null, kind: FileKind): Promise<void> {
  const run = history?.longestRun() ?? [];
  if (!history || run.length < 2) {
    throw new Error("There is no motion to save yet; wait until the body moves.");
  }
  const { skeleton } = history;
  const motion = resample(run, skeleton.joints);
  if (kind === "bvh") {
    download(new Blob([bvhText(skeleton, motion)], { type: "text/plain" }), "bodysense.bvh");
    return;
  }
  const { glbBytes } = await import("./glb"); // the exporter is fetched when it is wanted
  download(new Blob([await glbBytes(skeleton, motion)], { type: "model/gltf-binary" }), "bodysense.glb");
}

function download(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
