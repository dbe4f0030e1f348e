/** The worker that completes bodies, so that rendering never waits. */

import { openModel } from "@bodysense/core";
import type { Observation } from "../body/observation";
import type { Person } from "../wearer/wearer";
import { defaultSkeleton, unpacked } from "./files";
import { Tracker, type Completed } from "./tracker";

export type ToEngine =
  | { readonly type: "open"; readonly base: string } // address of the page's folder
  | { readonly type: "start"; readonly person: Person; readonly holdFeet: boolean }
  | { readonly type: "person"; readonly person: Person }
  | { readonly type: "holdFeet"; readonly holdFeet: boolean }
  | { readonly type: "step"; readonly id: number; readonly observation: Observation };

export type FromEngine =
  | { readonly type: "opened" }
  | { readonly type: "completed"; readonly id: number; readonly completed: Completed; readonly milliseconds: number }
  | { readonly type: "failed"; readonly id: number | null; readonly reason: string };

const send = (message: FromEngine): void => postMessage(message);
let tracker: Tracker | null = null;
let opening: Promise<void> | null = null; // the page asks twice: before its modules run, and when it can listen
let turn: Promise<void> = Promise.resolve(); // messages are taken one after the other

async function open(base: string): Promise<void> {
  const [weights, wasm, skeleton] = await Promise.all([
    unpacked(base, "completion.safetensors.gz"),
    unpacked(base, "core.wasm.gz"),
    defaultSkeleton(base),
  ]);
  tracker = new Tracker(await openModel(new Uint8Array(weights), wasm), skeleton);
}

async function take(message: ToEngine): Promise<void> {
  if (message.type === "open") {
    await (opening ??= open(message.base));
    send({ type: "opened" });
    return;
  }
  if (!tracker) return;
  if (message.type === "start") {
    tracker.holdFeet = message.holdFeet;
    tracker.start(message.person);
  } else if (message.type === "person") tracker.setPerson(message.person);
  else if (message.type === "holdFeet") tracker.holdFeet = message.holdFeet;
  else {
    const began = performance.now();
    const completed = tracker.step(message.observation);
    const milliseconds = performance.now() - began;
    send({ type: "completed", id: message.id, completed, milliseconds });
  }
}

addEventListener("message", ({ data }: MessageEvent<ToEngine>) => {
  turn = turn
    .then(() => take(data))
    .catch((error: unknown) => {
      const reason = error instanceof Error ? error.message : String(error);
      send({ type: "failed", id: data.type === "step" ? data.id : null, reason });
    });
});
