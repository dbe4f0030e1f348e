/** The take in this browser's storage, so that a reload loses nothing. */

import type { BodyFrame } from "./history";
import { isRefused } from "./settings";
import type { Keeper } from "./take";

const [NAME, STORE] = ["bodysense", "take"];

/** Stored frames. */
interface Chunk {
  readonly time: Float64Array; // s
  readonly root: Float32Array; // (frames × 3) m
  readonly rotation: Float32Array; // (frames × joints × 4) wxyz
  readonly restOffset: Float32Array; // (points × 3) m, of the last
}

export class KeptTake implements Keeper {
  private turn: Promise<void> = Promise.resolve(); // one after the other
  private hasFailed = false; // with this take: nothing more of it is kept

  constructor(private readonly failed: (error: Error) => void) {}

  add(frames: readonly BodyFrame[], isFirst: boolean): void {
    if (isFirst) this.hasFailed = false;
    this.turn = this.turn.then(() => this.put(chunkOf(frames), isFirst)).catch((error: unknown) => this.fail(error));
  }

  /** Load the stored take of bodies with `joints` joints; empty without storage. */
  async load(joints: number): Promise<readonly BodyFrame[]> {
    const chunks = await inStore<Chunk[]>("readonly", (store) => store.getAll()).catch(() => []);
    const isWhole = chunks.every(({ time, rotation }) => rotation.length === 4 * joints * time.length);
    return isWhole ? chunks.flatMap((chunk) => framesOf(chunk, joints)) : [];
  }

  private async put(chunk: Chunk, isFirst: boolean): Promise<void> {
    if (this.hasFailed) return;
    await inStore("readwrite", (store) => {
      if (isFirst) store.clear();
      return store.add(chunk);
    });
  }

  private fail(error: unknown): void {
    if (this.hasFailed) return;
    this.hasFailed = true;
    const why = isRefused(error) ? "This browser lets the page store nothing" : "This browser's storage is full";
    this.failed(new Error(`${why}: your take is kept until you leave the page; save it as a file.`));
  }
}

async function inStore<T>(mode: IDBTransactionMode, ask: (store: IDBObjectStore) => IDBRequest): Promise<T> {
  const database = await new Promise<IDBDatabase>((resolve, reject) => {
    const opening = indexedDB.open(NAME, 1);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE, { autoIncrement: true });
    opening.onsuccess = () => resolve(opening.result);
    opening.onerror = () => reject(opening.error ?? new Error("refused"));
  });
  try {
    return await new Promise<T>((resolve, reject) => {
      const transaction = database.transaction(STORE, mode);
      const request = ask(transaction.objectStore(STORE));
      transaction.oncomplete = () => resolve(request.result as T);
      transaction.onabort = transaction.onerror = () => reject(transaction.error ?? new Error("refused"));
    });
  } finally {
    database.close();
  }
}

function chunkOf(frames: readonly BodyFrame[]): Chunk {
  const joined = (parts: readonly Float32Array[]): Float32Array => {
    const values = new Float32Array(parts.reduce((sum, part) => sum + part.length, 0));
    let at = 0;
    for (const part of parts) {
      values.set(part, at);
      at += part.length;
    }
    return values;
  };
  return {
    time: Float64Array.from(frames, ({ time }) => time),
    root: joined(frames.map(({ rootPosition }) => rootPosition)),
    rotation: joined(frames.map(({ rotation }) => rotation)),
    restOffset: frames[frames.length - 1].restOffset,
  };
}

function framesOf({ time, root, rotation, restOffset }: Chunk, joints: number): BodyFrame[] {
  return Array.from(time, (seconds, k) => ({
    time: seconds,
    rootPosition: root.subarray(3 * k, 3 * k + 3),
    rotation: rotation.subarray(4 * joints * k, 4 * joints * (k + 1)),
    restOffset,
  }));
}
