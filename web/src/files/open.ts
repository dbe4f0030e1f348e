/** A file that was dropped or chosen: a motion, a recording or an avatar. */

import type { Clip } from "../body/clip";
import { readNpz } from "./npz";
import type { Observation } from "../body/observation";
import type { Skeleton } from "../body/skeleton";
import type { Avatar } from "../view/avatar";
import { AMASS_ARRAYS, amassClip } from "./amass";
import { readBvh } from "./bvh_read";
import { RECORDING_ARRAYS, recordingOf, recordingOfLines } from "./recording";
import { clipOf } from "./rig";

export type Opened =
  | { readonly kind: "motion"; readonly clip: Clip }
  | { readonly kind: "recording"; readonly frames: readonly Observation[] }
  | { readonly kind: "avatar"; readonly avatar: Avatar };

const FILM = /\.(mp4|mov|m4v|webm|mkv|avi|gif)$/i;
const LARGEST = 200; // MB
const GLB_MAGIC = 0x46546c67; // "glTF", little-endian
const ZIP_MAGIC = 0x04034b50;
const READ: ReadonlySet<string> = new Set([...AMASS_ARRAYS, ...RECORDING_ARRAYS]);

/** Open a file. Throws an Error of one line if the page cannot use it. */
export async function openFile(
  file: Pick<File, "name" | "size" | "arrayBuffer" | "text">,
  tree: Skeleton,
): Promise<Opened> {
  const { name } = file;
  if (FILM.test(name))
    throw new Error(
      `${name} is a film: complete it with \`bodysense track ${name} -o body.bvh\`, and drop body.bvh here.`,
    );
  const megabytes = file.size / 1e6;
  if (megabytes > LARGEST)
    throw new Error(
      `${name} has ${megabytes.toFixed(0)} MB; this page takes ${LARGEST} MB: cut it, or make its textures smaller.`,
    );
  if (/\.bvh$/i.test(name)) return { kind: "motion", clip: clipOf(readBvh(await file.text(), name), tree) };
  if (/\.jsonl$/i.test(name))
    return { kind: "recording", frames: await about(name, async () => recordingOfLines(await file.text())) };
  const bytes = await file.arrayBuffer();
  const magic = bytes.byteLength >= 4 ? new DataView(bytes).getUint32(0, true) : 0;
  if (magic === ZIP_MAGIC) {
    const archive = await about(name, () => readNpz(bytes, READ));
    if (archive.has("poses") && archive.has("trans"))
      return { kind: "motion", clip: await about(name, async () => amassClip(archive, name, tree)) };
    return { kind: "recording", frames: await about(name, async () => recordingOf(archive)) };
  }
  if (magic === GLB_MAGIC) return openGlb(bytes, name, tree);
  throw new Error(
    `${name} is nothing that this page reads; drop a motion (.bvh, .glb, .vrma, AMASS .npz), a recording (.npz, .jsonl) or an avatar (.vrm).`,
  );
}

/** Fetch a file that an address names. Throws an Error of one line if it cannot be read. */
export async function fileAt(address: string, base: string): Promise<File> {
  const answer = await fetch(new URL(address, base), { credentials: "omit" }).catch(() => null);
  if (!answer?.ok)
    throw new Error(`${address} cannot be fetched: it is not there, or its host allows no other page to read it.`);
  return new File([await answer.blob()], decodeURIComponent(new URL(answer.url).pathname.split("/").at(-1) ?? address));
}

async function openGlb(bytes: ArrayBuffer, name: string, tree: Skeleton): Promise<Opened> {
  const [{ Avatar, readGlb }, { rigOfGlb }] = await Promise.all([import("../view/avatar"), import("./glb_read")]);
  const file = await readGlb(bytes, name);
  const { avatarOfGlb, isFigure } = await import("./glb_person");
  const avatar = Avatar.of(file, name) ?? (isFigure(file) ? avatarOfGlb(file, name, tree) : null);
  return avatar ? { kind: "avatar", avatar } : { kind: "motion", clip: clipOf(rigOfGlb(file, name), tree) };
}

async function about<T>(name: string, read: () => Promise<T>): Promise<T> {
  try {
    return await read();
  } catch (error) {
    throw new Error(`${name} cannot be used: ${error instanceof Error ? error.message : "it is damaged"}.`);
  }
}
