/** The page's files from the library, which `bodysense page` copies next to its code. */

import { inflated } from "../files/npz";
import { skeletonOfRows, type Skeleton, type SkeletonRows } from "../body/skeleton";

export async function fetched(base: string, name: string): Promise<ArrayBuffer> {
  const response = await fetch(new URL(name, base)).catch(() => null);
  if (!response?.ok)
    throw new Error(`${name} cannot be fetched; is this folder whole, as \`bodysense page\` writes it?`);
  return response.arrayBuffer();
}

/** A file that is kept packed, so that any host sends it small. */
export async function unpacked(base: string, name: string): Promise<ArrayBuffer> {
  const bytes = await fetched(base, name);
  return inflated(bytes, "gzip").catch(() => {
    throw new Error(`${name} is damaged; load the page again.`);
  });
}

/** The content of a file of JSON. */
export async function readJson<T>(base: string, name: string): Promise<T> {
  return JSON.parse(new TextDecoder().decode(await fetched(base, name))) as T;
}

export async function defaultSkeleton(base: string): Promise<Skeleton> {
  const text = new TextDecoder().decode(await unpacked(base, "default_body.json.gz"));
  return skeletonOfRows(JSON.parse(text) as SkeletonRows);
}
