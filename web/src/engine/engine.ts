/** The page's side of the worker: observations in, bodies out, the newest first where it cannot keep up. */

import type { Observation } from "../body/observation";
import { NOBODY, type Person } from "../wearer";
import type { FromEngine, ToEngine } from "./messages";
import { TRACKER_SETTINGS, type Completed, type TrackerSettings } from "./tracker";

export interface Step {
  readonly body: Completed;
  readonly milliseconds: number; // that the step took in the worker
}

export class Engine {
  readonly opened: Promise<void>;
  private worker: Worker | null = null;
  private readonly early: ToEngine[] = []; // told before it was opened
  private readonly waiting = new Map<number, (step: Step | Error) => void>();
  private id = 0;

  private resolve: () => void = () => undefined;
  private reject: (error: Error) => void = () => undefined;

  constructor(private readonly base: string) {
    this.opened = new Promise((resolve, reject) => {
      this.resolve = resolve;
      this.reject = reject;
    });
  }

  /** Begin to fetch the core and its weights; once. */
  open(): void {
    if (this.worker) return;
    const global = globalThis as { engineWorker?: Worker }; // the built page starts it before its modules run
    global.engineWorker ??= new Worker(new URL("./worker.ts", import.meta.url), { type: "module", name: "engine" });
    this.worker = global.engineWorker;
    this.worker.onmessage = ({ data }: MessageEvent<FromEngine>) => {
      if (data.type === "opened") this.resolve();
      else if (data.type === "completed") this.answer(data.id, data);
      else if (data.id === null) this.reject(new Error(data.reason));
      else this.answer(data.id, new Error(data.reason));
    };
    this.worker.onerror = () => this.reject(new Error("This browser cannot run the network; use a newer one."));
    this.tell({ type: "open", base: this.base });
    for (const message of this.early.splice(0)) this.tell(message);
  }

  /** How many frames were given and are not answered yet. */
  get backlog(): number {
    return this.waiting.size;
  }

  start(person: Person = NOBODY, settings: TrackerSettings = TRACKER_SETTINGS): void {
    this.tell({ type: "start", person, settings });
  }

  person(person: Person): void {
    this.tell({ type: "person", person });
  }

  settings(settings: TrackerSettings): void {
    this.tell({ type: "settings", settings });
  }

  step(observation: Observation): Promise<Step> {
    const id = this.id++;
    this.tell({ type: "step", id, observation });
    return new Promise((resolve, reject) => {
      this.waiting.set(id, (answer) => (answer instanceof Error ? reject(answer) : resolve(answer)));
    });
  }

  private answer(id: number, step: Step | Error): void {
    this.waiting.get(id)?.(step);
    this.waiting.delete(id);
  }

  private tell(message: ToEngine): void {
    if (this.worker) this.worker.postMessage(message);
    else this.early.push(message);
  }
}
