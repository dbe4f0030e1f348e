/** The network's graph in ONNX Runtime: WebAssembly, one thread. */

import * as ort from "onnxruntime-web/wasm";
import type { Graph, Inputs, Outputs } from "../core/tracker";
import { completionCard } from "./card";

interface StateRow {
  readonly shape: readonly number[];
  readonly start: readonly number[] | null;
}

const READ = ["root_position", "local_rotation", "points", "confidence"]; // the page has no use for the others

/** Open a network from the bytes of its file and of the runtime.
 *
 * Tensors that a run reads are made once, and a state goes back in as it came out: what steps leave to the garbage
 * collector, it collects in the time of a step.
 */
export async function openGraph(network: ArrayBuffer, runtime: ArrayBuffer): Promise<Graph> {
  const card = completionCard(new Uint8Array(network));
  ort.env.wasm.numThreads = 1;
  ort.env.wasm.wasmBinary = runtime;
  ort.env.logLevel = "error";
  const session = await ort.InferenceSession.create(network, {
    executionProviders: ["wasm"],
    graphOptimizationLevel: "all",
    freeDimensionOverrides: { batch: 1 },
  });
  const first = startOf(card["state"] as Record<string, StateRow>);
  const rest = session.inputMetadata.filter(({ name }) => !(name in first)).map((row) => [row.name, emptyTensor(row)]);
  const feeds = { ...(Object.fromEntries(rest) as Record<string, ort.Tensor>), ...first };
  const states = Object.keys(first).map((name) => [name, name.replace("state_", "next_")] as const);
  const fetches = [...READ, ...states.map(([, after]) => after)];
  const run = async (): Promise<Outputs> => {
    const outputs = await session.run(feeds, fetches);
    for (const [before, after] of states) feeds[before] = outputs[after];
    const read = (name: string): Float32Array => outputs[name].data as Float32Array;
    return {
      rootPosition: read("root_position"),
      localRotation: read("local_rotation"),
      points: read("points"),
      confidence: read("confidence"),
    };
  };
  return { inputs: inputsOf(feeds), start: () => void Object.assign(feeds, first), run };
}

function emptyTensor(row: ort.InferenceSession.ValueMetadata): ort.Tensor {
  if (!row.isTensor) throw new Error(`completion.onnx has an input ${row.name} that is no tensor.`);
  const dims = row.shape.map((size) => (typeof size === "number" ? size : 1));
  const size = dims.reduce((product, n) => product * n, 1);
  return row.type === "bool"
    ? new ort.Tensor("bool", new Uint8Array(size), dims)
    : new ort.Tensor("float32", new Float32Array(size), dims);
}

function inputsOf(feeds: Readonly<Record<string, ort.Tensor>>): Inputs {
  const floats = (name: string): Float32Array => feeds[name].data as Float32Array;
  const flags = (name: string): Uint8Array => feeds[name].data as Uint8Array;
  return {
    position: floats("position"),
    rotation: floats("rotation"),
    hasPosition: flags("has_position"),
    hasRotation: flags("has_rotation"),
    accuracy: floats("accuracy"),
    interval: floats("interval"),
    restOffset: floats("rest_offset"),
    certainty: floats("certainty"),
    floor: floats("floor"),
    hold: floats("hold"),
  };
}

function startOf(rows: Readonly<Record<string, StateRow>>): Record<string, ort.Tensor> {
  return Object.fromEntries(
    Object.entries(rows).map(([name, { shape, start }]) => {
      const size = shape.reduce((product, n) => product * n, 1);
      const data = Float32Array.from({ length: size }, (_, k) => start?.[k] ?? 0);
      return [`state_${name}`, new ort.Tensor("float32", data, [1, ...shape])];
    }),
  );
}
