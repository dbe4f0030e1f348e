/** The worker that finds a person in pictures: MediaPipe's pose and hand landmarkers. */

import { HandLandmarker, PoseLandmarker, type NormalizedLandmark, type Landmark } from "@mediapipe/tasks-vision";

/** A hand in a picture: 21 landmarks, as MediaPipe gives them. */
export interface SeenHand {
  readonly world: readonly Landmark[];
  readonly picture: readonly NormalizedLandmark[];
  readonly left: number; // probability that it is a left hand
}

export type ToCamera =
  | { readonly type: "open"; readonly base: string }
  | { readonly type: "look"; readonly picture: ImageBitmap; readonly milliseconds: number };

export type FromCamera =
  | { readonly type: "opened" }
  | {
      readonly type: "seen";
      readonly world: readonly Landmark[];
      readonly picture: readonly NormalizedLandmark[];
      readonly hands: readonly SeenHand[];
      readonly image: ImageBitmap; // that they were found in
      readonly milliseconds: number;
    }
  | { readonly type: "failed"; readonly reason: string };

const [POSE, HANDS] = ["pose_landmarker_full.task", "hand_landmarker.task"];
const SURE = 0.4; // least probability of a hand that is found
let poses: PoseLandmarker | null = null;
let hands: HandLandmarker | null = null;

const send = (message: FromCamera, given: Transferable[] = []): void => postMessage(message, { transfer: given });

/** Set the global by which MediaPipe's loader hands over its WebAssembly. MediaPipe clears it after each landmarker, and
 * a second import of the loader does not run it again. */
async function offerFactory(loader: string): Promise<void> {
  const { default: ModuleFactory } = (await import(/* @vite-ignore */ loader)) as { readonly default: unknown };
  Object.assign(globalThis, { ModuleFactory });
}

async function open(base: string): Promise<void> {
  const at = (name: string): string => new URL(name, base).href;
  const files = {
    wasmLoaderPath: at("vision_wasm_module_internal.js"),
    wasmBinaryPath: at("vision_wasm_module_internal.wasm"),
  };
  await offerFactory(files.wasmLoaderPath);
  poses = await PoseLandmarker.createFromOptions(files, {
    baseOptions: { modelAssetPath: at(POSE), delegate: "CPU" },
    runningMode: "VIDEO",
    numPoses: 1,
  });
  await offerFactory(files.wasmLoaderPath);
  hands = await HandLandmarker.createFromOptions(files, {
    baseOptions: { modelAssetPath: at(HANDS), delegate: "CPU" },
    runningMode: "VIDEO",
    numHands: 2,
    minHandDetectionConfidence: SURE,
  });
  send({ type: "opened" });
}

async function look(image: ImageBitmap, milliseconds: number): Promise<void> {
  const result = poses?.detectForVideo(image, milliseconds);
  const [world, picture] = [result?.worldLandmarks[0] ?? [], result?.landmarks[0] ?? []];
  const found = hands?.detectForVideo(image, milliseconds);
  const seen = (found?.landmarks ?? []).map((places, k): SeenHand => {
    const [side] = found?.handedness[k] ?? [];
    // The labels are right for pictures that are not mirrored.
    const left = side ? (side.categoryName === "Left" ? side.score : 1 - side.score) : 0.5;
    return { world: found?.worldLandmarks[k] ?? [], picture: places, left };
  });
  send({ type: "seen", world, picture, hands: seen, image, milliseconds }, [image]);
}

addEventListener("message", ({ data }: MessageEvent<ToCamera>) => {
  void (data.type === "open" ? open(data.base) : look(data.picture, data.milliseconds)).catch((error: unknown) =>
    send({ type: "failed", reason: error instanceof Error ? error.message : String(error) }),
  );
});
