/** What is kept as xz: two thirds of its gzip where it is code. No browser unpacks it by itself. */

import { XzReadableStream } from "xz-decompress";
import { damaged, fetched } from "./files";

export async function unpackedXz(base: string, name: string): Promise<ArrayBuffer> {
  const bytes = await fetched(base, name);
  return new Response(new XzReadableStream(new Blob([bytes]).stream())).arrayBuffer().catch(() => damaged(name));
}
