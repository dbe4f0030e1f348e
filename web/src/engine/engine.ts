/** The page's side of the worker: observations in, bodies out, the newest first where it cannot keep up. */

import type { Observation } from "../body/observation";
import type { FromEngine, ToEngine } from "./worker";

/** A completed body, and how long that took in the worker. */
export type Step = Pick<Extract<FromEngine, { type: "completed" }>, "completed" | "milliseconds">;

export class Engine {
  readonly opened: Promise<void>;
  private readonly worker: Worker;
  private readonly waiting = new Map<number, (step: Step | Error) => void>();
  private id = 0;

  /** Begin to fetch the core and its weights. */
  constructor(base: string) {
    const global = globalThis as { engineWorker?: Worker }; // the built page starts it before its modules run
    global.engineWorker ??= new Worker(new URL("./worker.ts", import.meta.url), { type: "module", name: "engine" });
    this.worker = global.engineWorker;
    this.opened = new Promise((resolve, reject) => {
      this.worker.onmessage = ({ data }: MessageEvent<FromEngine>) => {
        if (data.type === "opened") resolve();
        else if (data.type === "completed") this.answer(data.id, data);
        else if (data.id === null) reject(new Error(data.reason));
        else this.answer(data.id, new Error(data.reason));
      };
      this.worker.onerror = () => reject(new Error("This browser cannot run the network; use a newer one."));
    });
    this.send({ type: "open", base });
  }

  /** How many frames were given and are not answered yet. */
  get backlog(): number {
    return this.waiting.size;
  }

  send(message: ToEngine): void {
    this.worker.postMessage(message);
  }

  step(observation: Observation): Promise<Step> {
    const id = this.id++;
    this.send({ type: "step", id, observation });
    return new Promise((resolve, reject) => {
      this.waiting.set(id, (answer) => (answer instanceof Error ? reject(answer) : resolve(answer)));
    });
  }

  private answer(id: number, step: Step | Error): void {
    this.waiting.get(id)?.(step);
    this.waiting.delete(id);
  }
}
