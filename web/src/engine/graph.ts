/** The network's graph in ONNX Runtime: WebAssembly, one thread. */

import * as ort from "onnxruntime-web/wasm";
import type { Graph, GraphTensor, Tensors } from "../core/tracker";
import { completionCard } from "./card";

interface StateRow {
  readonly shape: readonly number[];
  readonly start: readonly number[] | null;
}

/** Open a network from the bytes of its file and of the runtime. */
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
  const run = async (inputs: Tensors): Promise<Tensors> => {
    const feeds = session.inputNames.map((name) => [name, tensorOf(inputs[name])] as const);
    const outputs = await session.run(Object.fromEntries(feeds));
    return Object.fromEntries(Object.entries(outputs).map(([name, tensor]) => [name, copied(tensor)]));
  };
  return { start: startOf(card["state"] as Record<string, StateRow>), run };
}

function startOf(rows: Readonly<Record<string, StateRow>>): Tensors {
  return Object.fromEntries(
    Object.entries(rows).map(([name, { shape, start }]) => {
      const size = shape.reduce((product, n) => product * n, 1);
      const data = Float32Array.from({ length: size }, (_, k) => start?.[k] ?? 0);
      return [`state_${name}`, { type: "float32", data, dims: shape } satisfies GraphTensor];
    }),
  );
}

function tensorOf({ type, data, dims }: GraphTensor): ort.Tensor {
  return new ort.Tensor(type, data as Float32Array, [1, ...dims]);
}

function copied(tensor: ort.Tensor): GraphTensor {
  return { type: "float32", data: tensor.data as Float32Array, dims: tensor.dims.slice(1) };
}
