/** Downloads of the timeline or a take, as BVH, glTF or VRMA. */

import { withOffsets, type Skeleton } from "../body/skeleton";
import type { BodyFrame } from "../takes/history";
import { bvhText } from "./bvh";
import { resample } from "./resample";

export const FILE_KINDS = ["bvh", "glb", "vrma"] as const;
export type FileKind = (typeof FILE_KINDS)[number];

/** Throws an Error of one line while there is nothing to save. */
export async function saveMotion(
  tree: Skeleton,
  run: readonly BodyFrame[],
  kind: FileKind,
  name: string,
): Promise<void> {
  const last = run.at(-1);
  if (!last || run.length < 2) throw new Error("There is no motion to save yet; wait until the body moves.");
  const skeleton = withOffsets(tree, last.restOffset);
  const motion = resample(run, skeleton.joints);
  if (kind === "bvh") {
    download(new Blob([bvhText(skeleton, motion)], { type: "text/plain" }), `${name}.bvh`);
    return;
  }
  const { glbBytes, vrmaBytes } = await import("./glb"); // the exporter is fetched when it is wanted
  const bytes = await (kind === "glb" ? glbBytes : vrmaBytes)(skeleton, motion);
  download(new Blob([bytes], { type: "model/gltf-binary" }), `${name}.${kind}`);
}

function download(content: Blob, name: string): void {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(content);
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}
