/** Storage of takes in this browser, so that they survive a reload. */

import type { BodyFrame } from "./history";
import { whyNotStored } from "../settings";
import type { Description, Keeper, Take } from "./takes";

const [NAME, STORE, VERSION] = ["bodysense", "takes", 2] as const;

/** Stored frames; the key is the take's id and the time of the first frame. */
interface Chunk {
  readonly time: Float64Array; // s
  readonly root: Float32Array; // (frames × 3) m
  readonly rotation: Float32Array; // (frames × joints × 4) wxyz
  readonly restOffset: Float32Array; // (points × 3) m, of the last
}

export class KeptTakes implements Keeper {
  private turn: Promise<void> = Promise.resolve(); // the last write; writes run one after another
  private failing: number | null = null; // the take that could not be stored: the rest of it is not tried

  constructor(private readonly failed: (error: Error) => void) {}

  add(id: number, frames: readonly BodyFrame[]): void {
    if (frames.length > 0) this.write(id, (store) => store.put(chunkOf(frames), [id, frames[0].time]));
  }

  describe({ id, name, part }: Description): void {
    this.write(id, (store) => store.put({ id, name, part }, [id]));
  }

  remove(id: number): void {
    this.write(id, (store) => store.delete(IDBKeyRange.bound([id], [id + 1], false, true)));
  }

  /** Load the stored takes of bodies with `joints` joints; none without storage. */
  async load(joints: number): Promise<readonly Take[]> {
    const keys = await inStore<[number, number?][]>("readonly", (store) => store.getAllKeys()).catch(() => []);
    const values = await inStore<unknown[]>("readonly", (store) => store.getAll()).catch(() => []);
    return [...new Set(keys.map(([id]) => id))].flatMap((id, number) => {
      const own = keys.flatMap((key, row) => (key[0] === id ? [[key, values[row]] as const] : []));
      const chunks = own.flatMap(([key, value]) => (key.length === 2 ? [value as Chunk] : []));
      const described = own.find(([key]) => key.length === 1)?.[1] as Description | undefined; // missing: the page died
      const isWhole = chunks.every(({ time, rotation }) => rotation.length === 4 * joints * time.length);
      const frames = isWhole ? chunks.flatMap((chunk) => framesOf(chunk, joints)) : [];
      return frames.length > 1
        ? [{ id, name: described?.name ?? `Take ${number + 1}`, part: described?.part ?? null, frames }]
        : [];
    });
  }

  private write(id: number, ask: (store: IDBObjectStore) => IDBRequest): void {
    this.turn = this.turn
      .then(async () => {
        if (this.failing !== id) await inStore("readwrite", ask);
      })
      .catch((error: unknown) => {
        this.failing = id;
        const why = whyNotStored(error);
        this.failed(new Error(`${why}: your take is kept until you leave the page; save it as a file.`));
      });
  }
}

async function inStore<T>(mode: IDBTransactionMode, ask: (store: IDBObjectStore) => IDBRequest): Promise<T> {
  const database = await new Promise<IDBDatabase>((resolve, reject) => {
    const opening = indexedDB.open(NAME, VERSION);
    opening.onupgradeneeded = () => opening.result.createObjectStore(STORE);
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
  const joined = (rows: readonly Float32Array[]): Float32Array => {
    const values = new Float32Array(rows.length * rows[0].length);
    rows.forEach((row, k) => values.set(row, k * row.length));
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
