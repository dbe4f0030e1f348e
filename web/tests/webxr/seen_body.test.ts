/** The body that a headset itself tracks, from a shim of WebXR's body tracking, completes the rest. */

import { openModel, type Estimate, type Point } from "@bodysense/core";
import { HeadsetReader } from "@bodysense/core/webxr";
import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { jointPoses, type JointPose } from "../../core/src/xr_joints";
import { axisAngle, conjugate, multiply, type Quaternion, type Vector } from "../../src/body/math";
import { place, rootHeight, worldRotations } from "../../src/body/skeleton";
import { skeleton } from "../body";

const RATE = 30;
const bytes = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));
const space = {} as XRReferenceSpace;
const HANDS = ["wrist", "thumb", "index", "middle", "ring", "pinky"];

/** The truth at a time: a person stands on the right leg and swings the left one, head and hands still. */
function truth(time: number): Estimate {
  const rotation = Float64Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
  const turn = (name: string, q: Quaternion) => rotation.set(q, 4 * skeleton.points.indexOf(name));
  const swing = 0.5 - 0.5 * Math.cos(2 * time);
  turn("left_hip", multiply(axisAngle([0, 0, 1], 0.7 * swing), axisAngle([1, 0, 0], -0.6 * swing)));
  turn("left_knee", axisAngle([1, 0, 0], 0.9 * swing));
  turn("left_shoulder", axisAngle([0, 0, 1], -1.2));
  turn("right_shoulder", axisAngle([0, 0, 1], 1.2));
  const height = rootHeight(skeleton);
  const body = place(skeleton, [0, height, 0], rotation);
  return {
    rootPosition: Float64Array.from([0, height, 0]),
    rotation,
    points: Float64Array.from(body.position),
    measured: new Uint8Array(skeleton.points.length).fill(1),
    confidence: new Float64Array(0),
    bound: new Float64Array(0),
    contact: new Float64Array(4),
    restOffset: Float64Array.from(skeleton.restOffset),
  };
}

/** A frame of a headset that tracks joints itself; those that `isGuess` are its guesses. */
function bodyFrame(poses: ReadonlyMap<string, JointPose>, isGuess: (name: string) => boolean): XRFrame {
  const found = ({ position: [x, y, z], rotation: [w, a, b, c] }: JointPose, emulatedPosition: boolean) => ({
    transform: { position: { x, y, z }, orientation: { w, x: a, y: b, z: c } },
    emulatedPosition,
  });
  return {
    body: new Map([...poses.keys()].map((jointName) => [jointName, { jointName }])),
    getViewerPose: () => null,
    getPose: ({ jointName }: { jointName: string }) => found(poses.get(jointName)!, isGuess(jointName)),
  } as unknown as XRFrame;
}

const isLeg = (name: string) => /leg|foot/.test(name);
const pointOf = (body: Estimate, name: string): Vector => {
  const k = skeleton.points.indexOf(name);
  return [body.points[3 * k]!, body.points[3 * k + 1]!, body.points[3 * k + 2]!];
};
/** Head and wrists, as device and hand tracking give them. */
function devices(body: Estimate): Point[] {
  const world = worldRotations(skeleton, body.rotation);
  return ["head", "left_wrist", "right_wrist"].map((name) => {
    const k = skeleton.points.indexOf(name);
    const rotation = [0, 1, 2, 3].map((n) => world[4 * k + n]!) as unknown as Quaternion;
    return { name, position: pointOf(body, name), rotation, accuracy: 0.001 };
  });
}

describe("the headset's own body", () => {
  it("gives our joints where they are and as they are turned", () => {
    const body = truth(1);
    const world = worldRotations(skeleton, body.rotation);
    const points = new HeadsetReader().read(
      bodyFrame(jointPoses(body, skeleton.points), () => false),
      space,
      [],
    );
    expect(points.map(({ name }) => name)).toEqual(expect.arrayContaining(["left_knee", "right_elbow", "pelvis"]));
    for (const { name, position, rotation } of points) {
      const k = skeleton.points.indexOf(name);
      if (position) expect(Math.hypot(...position.map((v, n) => v - pointOf(body, name)[n]!)), name).toBeLessThan(1e-5);
      const theirs = [0, 1, 2, 3].map((n) => world[4 * k + n]!) as unknown as Quaternion;
      const [w] = multiply(conjugate(theirs), rotation!);
      expect((360 / Math.PI) * Math.acos(Math.min(1, Math.abs(w))), name).toBeLessThan(0.5);
    }
  });

  it("leaves guesses out, and is absent without the feature or when it is revoked", () => {
    const poses = jointPoses(truth(0), skeleton.points);
    const reader = new HeadsetReader();
    const names = (frame: XRFrame) => reader.read(frame, space, []).map(({ name }) => name);
    expect(names(bodyFrame(poses, isLeg)).filter((name) => /hip|knee|ankle|foot/.test(name))).toEqual([]);
    expect(names(bodyFrame(poses, isLeg))).toContain("left_elbow");
    for (const body of [null, undefined]) {
      const frame = Object.assign(
        bodyFrame(poses, () => false),
        { body },
      );
      expect(names(frame)).toEqual([]);
    }
  });

  it("halves the error of hidden joints, or better, if the headset sees the legs", async () => {
    const model = await openModel(
      bytes("../../../src/bodysense/weights/completion.safetensors"),
      bytes("../../core/core.wasm"),
    );
    const error = (seesLegs: boolean): number => {
      const state = model.start({});
      const reader = new HeadsetReader();
      let [sum, count] = [0, 0];
      for (let k = 0; k < 6 * RATE; k++) {
        const body = truth(k / RATE);
        const frame = bodyFrame(jointPoses(body, skeleton.points), (name) => !isLeg(name));
        const seen = seesLegs ? reader.read(frame, space, []) : [];
        const estimate = state.step({ time: k / RATE, points: [...devices(body), ...seen] });
        if (k < RATE) continue;
        for (const name of skeleton.points.filter(
          (one) => one !== "head" && !HANDS.some((part) => one.includes(part)),
        )) {
          sum += Math.hypot(...pointOf(estimate, name).map((v, n) => v - pointOf(body, name)[n]!));
          count++;
        }
      }
      state.close();
      return sum / count;
    };
    const [without, with_] = [error(false), error(true)];
    expect(with_).toBeLessThan(0.5 * without);
  }, 60_000);
});
