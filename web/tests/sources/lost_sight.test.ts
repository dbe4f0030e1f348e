/** A wearer whose hands or headset are lost for a while, from WebXR's frames to bodies: nothing leaps on its return. */

import { openModel } from "@bodysense/core";
import { readFileSync } from "node:fs";
import { Group, Scene } from "three";
import { afterEach, beforeAll, beforeEach, describe, expect, it, vi } from "vitest";
import { distance, vectorAt, type Vector } from "../../src/body/math";
import { Tracker, type Completed } from "../../src/engine/tracker";
import type { Live } from "../../src/live";
import { Headset } from "../../src/sources/headset";
import type { View } from "../../src/view/scene";
import type { VrMenu } from "../../src/view/vr_menu";
import { skeleton } from "../body";
import { emulated, RATE, type Emulated } from "../emulated";

vi.setConfig({ testTimeout: 60_000 });

const LEAP = 0.04; // m in a frame: 2.9 m/s, of hands that go to where they are seen
const wrist = skeleton.points.indexOf("right_wrist");
const bytes = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));
let model: Awaited<ReturnType<typeof openModel>>;
let headset: Emulated;

beforeAll(async () => {
  model = await openModel(
    bytes("../../../src/bodysense/weights/completion.safetensors"),
    bytes("../../core/core.wasm"),
  );
});
beforeEach(() => {
  headset = emulated();
});
afterEach(() => {
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

/** Put on an emulated headset and stand still; `bodies` completes the frames of some seconds. */
async function enterHeadset() {
  const { device } = headset;
  device.position.set(0, 1.6, 0);
  device.quaternion.set(0, 0, 0, 1);
  const requestSession = navigator.xr!.requestSession.bind(navigator.xr);
  let session!: XRSession;
  vi.spyOn(navigator.xr!, "requestSession").mockImplementation(
    async (...parameters) => (session = await requestSession(...parameters)),
  );
  let space: XRReferenceSpace;
  const xr = {
    getReferenceSpace: () => space,
    async setSession(begun: XRSession) {
      begun.updateRenderState({ baseLayer: headset.layer(begun) });
      space = await begun.requestReferenceSpace("local-floor");
    },
  };
  const view = { scene: new Scene(), stage: new Group(), renderer: { xr }, lightAt() {}, floorAt() {}, showRoom() {} };
  const menu = { board: new Group(), point: () => [], standBeside() {} };
  const tracker = new Tracker(model, skeleton);
  let body!: Completed;
  const live = { skeleton, tree: skeleton } as Live;
  const source = new Headset(view as unknown as View, live, menu as unknown as VrMenu, {
    tracked: (observation) => (body = tracker.step(observation)),
    left: () => undefined,
  });
  await source.enter("immersive-vr");
  let clock = 1000; // ms
  return {
    bodies: (seconds: number) =>
      Array.from({ length: Math.round(seconds * RATE) }, () => {
        headset.frames(session, 1, (frame) => source.frame((clock += 1000 / RATE), frame));
        return body;
      }),
    /** The headset's own menu or another app covers the page, which gets no frames. */
    hide(seconds: number) {
      clock += 1000 * seconds;
    },
  };
}

type Position = readonly [number, number, number];
function hold(mode: "controller" | "hand", left: Position, right: Position) {
  headset.device.primaryInputMode = mode;
  const both = mode === "hand" ? headset.device.hands : headset.device.controllers;
  both.left!.position.set(...left);
  both.right!.position.set(...right);
  return both;
}

const jointOf = ({ body: { position } }: Completed, joint: number): Vector => vectorAt(position, joint);
/** The furthest that a joint moves from one body to the next, m. */
function leap(before: Completed, after: Completed): number {
  const joints = Array.from({ length: skeleton.joints }, (_, joint) => joint);
  return Math.max(...joints.map((joint) => distance(jointOf(before, joint), jointOf(after, joint))));
}
const leaps = (bodies: readonly Completed[]): number[] => bodies.slice(1).map((next, k) => leap(bodies[k]!, next));

describe("both hands lost at once", () => {
  it.each(["controller", "hand"] as const)("stay where they were, and come back without a leap: %s", async (mode) => {
    const { bodies } = await enterHeadset();
    const both = hold(mode, [-0.2, 1.2, -0.35], [0.2, 1.2, -0.35]);
    const seen = bodies(2).at(-1)!;
    both.left!.connected = both.right!.connected = false;
    const lost = bodies(3);
    both.left!.connected = both.right!.connected = true;
    hold(mode, [-0.3, 0.9, 0], [0.3, 0.9, 0]); // at the hips
    const back = bodies(3);
    expect([seen, lost.at(-1)!, back.at(-1)!].map(({ measured }) => measured[wrist])).toEqual([1, 0, 1]);
    expect(leap(seen, lost[20]!)).toBeLessThan(0.1);
    expect(Math.max(...leaps([seen, ...lost, ...back]))).toBeLessThan(LEAP);
    expect(distance(jointOf(back.at(-1)!, wrist), [-0.3, 0.9, 0])).toBeLessThan(0.12); // turned to face +Z; a palm off
  });
});

describe("a headset that is hidden and comes back", () => {
  it.each([0.3, 2, 60])("goes on with the same motion after %s s where its wearer stayed", async (seconds) => {
    const { bodies, hide } = await enterHeadset();
    hold("controller", [-0.3, 0.9, 0], [0.3, 0.9, 0]);
    const before = bodies(3).at(-1)!;
    hide(seconds);
    const back = bodies(2);
    expect(Math.max(...leaps([before, ...back]))).toBeLessThan(LEAP);
    expect(back[0]!.time - before.time).toBeLessThan(1);
  });

  it("restarts the motion if its wearer went elsewhere", async () => {
    const { bodies, hide } = await enterHeadset();
    hold("controller", [-0.3, 0.9, 0], [0.3, 0.9, 0]);
    const before = bodies(3).at(-1)!;
    hide(5);
    headset.device.position.set(1, 1.6, 0);
    hold("controller", [0.7, 0.9, 0], [1.3, 0.9, 0]);
    const [first, ...more] = bodies(2);
    for (const name of ["head", "pelvis", "left_ankle"]) {
      const joint = skeleton.points.indexOf(name);
      const distance = Math.abs(jointOf(first!, joint)[0] - jointOf(before, joint)[0]);
      expect(distance, name).toBeCloseTo(1, 0.7); // at once: nothing is drawn after it
    }
    expect(Math.max(...leaps([first!, ...more]))).toBeLessThan(LEAP);
  });
});
