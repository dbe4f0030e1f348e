/** NumPy's .npz: a zip of arrays. Nothing in it is run. */

export interface NumpyArray {
  readonly shape: readonly number[];
  readonly values: Float64Array;
}

export type Archive = ReadonlyMap<string, NumpyArray | readonly string[]>;

const END = 0x06054b50;
const ENTRY = 0x02014b50;
const LARGEST = 2 ** 28; // bytes of one array
const MOST_NUMBERS = 40_000_000; // of one array: an hour of a whole body
const MOST_LETTERS = 100_000; // of one array of texts

/** Read arrays of an archive: those in `names` if given. Others are not unpacked.
 *
 * Throws an Error of a few words if it is damaged, or if an array holds more than a page should read.
 */
export async function readNpz(bytes: ArrayBuffer, names: ReadonlySet<string> | null = null): Promise<Archive> {
  const view = new DataView(bytes);
  const found = new Map<string, NumpyArray | readonly string[]>();
  let end = bytes.byteLength - 22;
  while (end >= 0 && view.getUint32(end, true) !== END) end--;
  if (end < 0) throw new Error("it is no .npz archive, or it was cut short");
  let at = view.getUint32(end + 16, true);
  for (let k = view.getUint16(end + 10, true); k > 0; k--) {
    if (at + 46 > bytes.byteLength || view.getUint32(at, true) !== ENTRY)
      throw new Error("its list of arrays is damaged");
    const method = view.getUint16(at + 10, true);
    const packed = view.getUint32(at + 20, true);
    const size = view.getUint32(at + 24, true);
    const [name, extra, comment] = [28, 30, 32].map((field) => view.getUint16(at + field, true));
    const local = view.getUint32(at + 42, true);
    const title = new TextDecoder().decode(new Uint8Array(bytes, at + 46, name));
    at += 46 + name + extra + comment;
    const key = title.replace(/\.npy$/, "");
    if (names && !names.has(key)) continue;
    const start = local + 30 + view.getUint16(local + 26, true) + view.getUint16(local + 28, true);
    if (start + packed > bytes.byteLength) throw new Error(`its array ${title} is damaged`);
    if (size > LARGEST)
      throw new Error(`its array ${title} has ${(size / 1e6).toFixed(0)} MB, more than this page reads`);
    const content = bytes.slice(start, start + packed);
    const whole = method === 0 ? content : await inflated(content, "deflate-raw", size);
    found.set(key, readNpy(whole, title));
  }
  return found;
}

/** Unpack. Throws an Error for more than `most` bytes, before they are there. */
export async function inflated(bytes: ArrayBuffer, format: CompressionFormat, most = LARGEST): Promise<ArrayBuffer> {
  let size = 0;
  const counted = new TransformStream<Uint8Array, Uint8Array>({
    transform: (chunk, out) => {
      size += chunk.byteLength;
      if (size > most) out.error(new Error("it holds more than it says"));
      else out.enqueue(chunk);
    },
  });
  const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream(format)).pipeThrough(counted);
  return new Response(unpacked).arrayBuffer();
}

/** Return an array of numbers by name. Throws an Error of a few words if it is missing or has another shape. */
export function numbers(archive: Archive, name: string, shape?: readonly (number | null)[]): NumpyArray {
  const array = archive.get(name);
  if (!array || !("shape" in array)) throw new Error(`it has no numbers ${name}`);
  const fits =
    !shape || (shape.length === array.shape.length && shape.every((n, k) => n === null || n === array.shape[k]));
  if (!fits) throw new Error(`its ${name} has the shape ${array.shape.join(" × ")}`);
  return array;
}

export function texts(archive: Archive, name: string): readonly string[] {
  const array = archive.get(name);
  if (!array || "shape" in array) throw new Error(`it has no texts ${name}`);
  return array;
}

function readNpy(bytes: ArrayBuffer, title: string): NumpyArray | readonly string[] {
  const view = new DataView(bytes);
  if (bytes.byteLength < 12 || view.getUint32(0) !== 0x934e554d) throw new Error(`its ${title} is no array`);
  const wide = view.getUint8(6) > 1;
  const begin = wide ? 12 : 10;
  const length = wide ? view.getUint32(8, true) : view.getUint16(8, true);
  const header = new TextDecoder().decode(new Uint8Array(bytes, begin, length));
  const kind = /'descr':\s*'([^']+)'/.exec(header)?.[1] ?? "";
  const shape = (/'shape':\s*\(([^)]*)\)/.exec(header)?.[1] ?? "")
    .split(",")
    .flatMap((n) => (n.trim() ? [Number(n)] : []));
  const count = shape.reduce((product, n) => product * n, 1);
  const data = begin + length;
  const text = /^(?:<U|\|S)(\d+)$/.exec(kind);
  if (text) {
    const [letters, bytesOfOne] = [Number(text[1]), kind.startsWith("<U") ? 4 : 1];
    if (letters * count > MOST_LETTERS) throw new Error(`its ${title} holds more text than this page reads`);
    if (data + bytesOfOne * letters * count > bytes.byteLength) throw new Error(`its ${title} was cut short`);
    const codes = (k: number) =>
      Array.from({ length: letters }, (_, c) => {
        const at = data + bytesOfOne * (k * letters + c);
        return bytesOfOne === 4 ? view.getUint32(at, true) : view.getUint8(at);
      });
    return Array.from({ length: count }, (_, k) => String.fromCodePoint(...codes(k).filter((code) => code > 0)));
  }
  if (count > MOST_NUMBERS) throw new Error(`its ${title} holds ${count} numbers, more than this page reads`);
  const Numbers = KINDS[kind as keyof typeof KINDS] as (typeof KINDS)[keyof typeof KINDS] | undefined;
  if (!Numbers) throw new Error(`its ${title} holds ${kind || "what is unknown"}`);
  const content = bytes.slice(data, data + Numbers.BYTES_PER_ELEMENT * count);
  if (content.byteLength < Numbers.BYTES_PER_ELEMENT * count) throw new Error(`its ${title} was cut short`);
  const read = new Numbers(content);
  const values = read instanceof BigInt64Array ? Float64Array.from(read, Number) : new Float64Array(read);
  return { shape, values: header.includes("'fortran_order': True") ? inRows(values, shape) : values };
}

/** Convert values from Fortran order (first index fastest) to C order (last index fastest). */
function inRows(values: Float64Array, shape: readonly number[]): Float64Array {
  const turned = new Float64Array(values.length);
  const at = shape.map(() => 0);
  for (let k = 0; k < values.length; k++) {
    let place = 0;
    for (let axis = 0; axis < shape.length; axis++) place = place * shape[axis] + at[axis];
    turned[place] = values[k];
    for (let axis = 0; axis < shape.length && ++at[axis] === shape[axis]; axis++) at[axis] = 0;
  }
  return turned;
}

const KINDS = {
  "<f4": Float32Array,
  "<f8": Float64Array,
  "<i4": Int32Array,
  "<i8": BigInt64Array,
  "|b1": Uint8Array,
  "|u1": Uint8Array,
} as const;
