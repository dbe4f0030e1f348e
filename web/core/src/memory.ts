/** The core's functions and its memory. Views hold until the next `take`, since memory that grows moves. */

const [ALIGNMENT, PAGE] = [64, 65536]; // bytes

export type Core = Record<`bs_${string}`, (...values: number[]) => number> & { memory: WebAssembly.Memory };
export type Memory = ReturnType<typeof memoryOf>;

/** Allocator of a core's memory, beyond the core's own data. */
export function memoryOf(core: Core) {
  const free: { at: number; size: number }[] = [];
  const rounded = (size: number): number => Math.ceil(size / ALIGNMENT) * ALIGNMENT;
  let end = core.memory.buffer.byteLength;
  const bytes = (at: number, count: number) => new Uint8Array(core.memory.buffer, at, count);
  const doubles = (at: number, count: number) => new Float64Array(core.memory.buffer, at, count);
  const integers = (at: number, count: number) => new Int32Array(core.memory.buffer, at, count);

  /** The address of unused bytes. */
  const take = (size: number): number => {
    const found = free.find((one) => one.size >= size);
    if (found) {
      found.at += rounded(size);
      found.size -= rounded(size);
      return found.at - rounded(size);
    }
    end += rounded(size);
    const lacking = end - core.memory.buffer.byteLength;
    if (lacking > 0) core.memory.grow(Math.ceil(lacking / PAGE));
    return end - rounded(size);
  };
  /** Bytes that were taken are unused again. */
  const giveBack = (at: number, size: number): void => void free.unshift({ at, size: rounded(size) });
  const text = (at: number): string => {
    const behind = new Uint8Array(core.memory.buffer, at);
    return new TextDecoder().decode(behind.slice(0, behind.indexOf(0)));
  };
  /** Throw an Error with the core's message for any result but BS_OK. */
  const check = (result: number, subject: string): void => {
    if (result !== 0) throw new Error(`${subject}: ${text(core.bs_message!(result))}`);
  };
  /** Write doubles. Throws an Error for another count of them. */
  const put = (at: number, count: number, values: ArrayLike<number>, subject: string): void => {
    if (values.length !== count) throw new Error(`${subject}: ${values.length} numbers; give ${count}`);
    doubles(at, count).set(values);
  };
  return { core, take, giveBack, bytes, doubles, integers, text, check, put };
}
