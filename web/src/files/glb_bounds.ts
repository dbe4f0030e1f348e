/** glTF: bounds of a binary file's JSON. Parsing far more of it would freeze the page. */

const LONGEST = 16e6; // bytes of JSON; avatars with hundreds of blend shapes have a few million
const DEEPEST = 128; // levels of brackets
const MOST = 5000; // nodes
const HEADER = 12; // bytes
const CHUNK_HEADER = 8; // bytes
const JSON_CHUNK = 0x4e4f534a; // "JSON", little-endian
const [QUOTE, BACKSLASH] = [0x22, 0x5c];
const [OPENING, CLOSING] = [new Set([0x5b, 0x7b]), new Set([0x5d, 0x7d])]; // [ {, ] }

/** Check the size of a file. Throws an Error of one line if its JSON is too long, too deep or has too many nodes. */
export function refuseHugeGlb(bytes: ArrayBuffer, name: string): void {
  for (const json of jsonChunks(bytes)) {
    if (json.length > LONGEST)
      throw new Error(
        `${name} lists its parts in ${Math.ceil(json.length / 1e6)} MB of text; this page takes ${LONGEST / 1e6} MB: export the figure alone.`,
      );
    if (depthOf(json) > DEEPEST)
      throw new Error(`${name} is nested in over ${DEEPEST} levels of brackets, as no figure is; export it again.`);
    const count = nodesIn(json);
    if (count > MOST)
      throw new Error(`${name} has ${count} nodes; this page takes ${MOST}: export the figure without its scenery.`);
  }
}

/** Damaged files lack it or a part of it; the loader refuses them. */
function* jsonChunks(bytes: ArrayBuffer): Generator<Uint8Array> {
  const view = new DataView(bytes);
  for (let at = HEADER; at + CHUNK_HEADER <= bytes.byteLength;) {
    const [size, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    at += CHUNK_HEADER;
    if (at + size > bytes.byteLength) return;
    if (kind === JSON_CHUNK) yield new Uint8Array(bytes, at, size);
    at += size;
  }
}

function depthOf(json: Uint8Array): number {
  let [depth, deepest, isText] = [0, 0, false];
  for (let at = 0; at < json.length; at++) {
    const sign = json[at];
    if (isText && sign === BACKSLASH) at++;
    else if (sign === QUOTE) isText = !isText;
    else if (isText) continue;
    else if (OPENING.has(sign)) deepest = Math.max(deepest, ++depth);
    else if (CLOSING.has(sign)) depth--;
  }
  return deepest;
}

function nodesIn(json: Uint8Array): number {
  try {
    const { nodes } = JSON.parse(new TextDecoder().decode(json)) as { nodes?: readonly unknown[] };
    return nodes?.length ?? 0;
  } catch {
    return 0; // not JSON: the loader refuses it
  }
}
