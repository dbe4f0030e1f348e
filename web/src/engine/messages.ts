/** Messages between the page and the worker that completes bodies. */

import type { Observation } from "../body/observation";
import type { Person } from "../wearer";
import type { Completed, TrackerSettings } from "./tracker";

export type ToEngine =
  | { readonly type: "open"; readonly base: string } // address of the page's folder
  | { readonly type: "start"; readonly person: Person; readonly settings: TrackerSettings }
  | { readonly type: "person"; readonly person: Person }
  | { readonly type: "settings"; readonly settings: TrackerSettings }
  | { readonly type: "step"; readonly id: number; readonly observation: Observation };

export type FromEngine =
  | { readonly type: "opened" }
  | { readonly type: "completed"; readonly id: number; readonly body: Completed; readonly milliseconds: number }
  | { readonly type: "failed"; readonly id: number | null; readonly reason: string };
