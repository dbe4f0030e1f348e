/** The worker that finds a person in pictures: MediaPipe's pose landmarker. */

import { PoseLandmarker, type NormalizedLandmark, type Landmark } from "@mediapipe/tasks-vision";

export type ToCamera =
  | { readonly type: "open"; readonly base: string }
  | { readonly type: "look"; readonly picture: ImageBitmap; readonly milliseconds: number };

export type FromCamera =
  | { readonly type: "opened" }
  | {
      readonly type: "seen";
      readonly world: readonly Landmark[];
      readonly picture: readonly NormalizedLandmark[];
      readonly image: ImageBitmap; // that they were found in
      readonly milliseconds: number;
    }
  | { readonly type: "failed"; readonly reason: string };

const MODEL = "pose_landmarker_full.task";
let landmarker: PoseLandmarker | null = null;

const send = (message: FromCamera, given: Transferable[] = []): void => postMessage(message, { transfer: given });

async function open(base: string): Promise<void> {
  const at = (name: string): string => new URL(name, base).href;
  const files = {
    wasmLoaderPath: at("vision_wasm_module_internal.js"),
    wasmBinaryPath: at("vision_wasm_module_internal.wasm"),
  };
  landmarker = await PoseLandmarker.createFromOptions(files, {
    baseOptions: { modelAssetPath: at(MODEL), delegate: "CPU" },
    runningMode: "VIDEO",
    numPoses: 1,
  });
  send({ type: "opened" });
}

async function look(image: ImageBitmap, milliseconds: number): Promise<void> {
  const result = landmarker?.detectForVideo(image, milliseconds);
  const [world, picture] = [result?.worldLandmarks[0] ?? [], result?.landmarks[0] ?? []];
  send({ type: "seen", world, picture, image, milliseconds }, [image]);
}

addEventListener("message", ({ data }: MessageEvent<ToCamera>) => {
  void (data.type === "open" ? open(data.base) : look(data.picture, data.milliseconds)).catch((error: unknown) =>
    send({ type: "failed", reason: error instanceof Error ? error.message : String(error) }),
  );
});
