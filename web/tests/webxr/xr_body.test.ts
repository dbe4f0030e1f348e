/** WebXR's body tracking by the package, on an emulated headset, against the specification's text. */

import { openModel } from "@bodysense/core";
import {
  installBodyTracking,
  type BodyTracking,
  type BodyTrackingOptions,
  type XRBodyFrame,
} from "@bodysense/core/webxr";
import { WebXRBodyTracking } from "@babylonjs/core/XR/features/WebXRBodyTracking.js";
import { readFileSync } from "node:fs";
import { afterEach, beforeAll, beforeEach, describe, expect, it, vi } from "vitest";
import { emulated, RATE, type Emulated } from "../emulated";

vi.setConfig({ testTimeout: 60_000 });

type Model = Awaited<ReturnType<typeof openModel>>;
type Place = [number, number, number];
const bytes = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));
const CHAINS = [
  ["hips", "spine-lower", "spine-middle", "spine-upper", "chest", "neck", "head"],
  ...["left", "right"].flatMap((side) => [
    ["shoulder", "scapula", "arm-upper", "arm-lower", "hand-wrist-twist", "hand-wrist"].map(
      (name) => `${side}-${name}`,
    ),
    ["hand-wrist", "hand-middle-metacarpal", "hand-middle-phalanx-proximal"].map((name) => `${side}-${name}`),
    ["upper-leg", "lower-leg", "foot-ankle-twist", "foot-ankle"].map((name) => `${side}-${name}`),
    ["foot-ankle", "foot-subtalar", "foot-transverse", "foot-ball"].map((name) => `${side}-${name}`),
    ["metacarpal", "phalanx-proximal", "phalanx-distal", "tip"].map((name) => `${side}-hand-thumb-${name}`),
    ...["index", "middle", "ring", "little"].map((finger) =>
      ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"].map(
        (name) => `${side}-hand-${finger}-${name}`,
      ),
    ),
  ]),
];

let model: Model;
let headset: Emulated;
let tracking: BodyTracking | null = null;

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
  tracking?.uninstall();
  tracking = null;
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

const install = (options: BodyTrackingOptions = {}) => (tracking = installBodyTracking(model, options));

/** A session with a floor, and the poses of its body after some frames. */
async function enterHeadset(features = ["body-tracking", "hand-tracking"], required: string[] = []) {
  const session = await headset.enter(features, required);
  const floor = await session.requestReferenceSpace("local-floor");
  /** Poses of joints in the last of some frames. */
  const poses = (count: number, names: readonly string[], base: XRSpace = floor) =>
    headset.frames(session, count, (frame) => names.map((name) => frame.getPose(frame.body!.get(name)!, base))).at(-1)!;
  return { session, floor, poses, pose: (count: number, name: string) => poses(count, [name])[0]! };
}
const place = ({ transform: { position: p } }: XRPose): Place => [p.x, p.y, p.z];
const axis = ({ transform: { matrix } }: XRPose, k: number): Place => [...matrix.slice(4 * k, 4 * k + 3)] as Place;
const between = (a: Place, b: Place): Place => [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
const dot = (a: Place, b: Place): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const distance = (a: XRPose, b: XRPose): number => Math.hypot(...between(place(a), place(b)));
const degrees = (a: XRPose, b: XRPose): number => {
  const [p, q] = [a.transform.orientation, b.transform.orientation];
  return (360 / Math.PI) * Math.acos(Math.min(1, Math.abs(p.x * q.x + p.y * q.y + p.z * q.z + p.w * q.w)));
};

describe("a session with body tracking", () => {
  it("has the 83 joints of the specification, in its order, in one object", async () => {
    install();
    const { session } = await enterHeadset();
    const bodies = headset.frames(session, 3, ({ body }) => body!);
    const names = WebXRBodyTracking.AllBodyJoints.map((name) =>
      name.replace("-middle-metacarpal", "-middle-phalanx-metacarpal"),
    );
    expect([...bodies[0]!.keys()]).toEqual(names);
    expect([bodies[0]!.size, new Set(bodies).size]).toEqual([83, 1]);
    expect([...bodies[0]!.values()].map(({ jointName }) => jointName)).toEqual(names);
    expect(bodies[0]!.get("left-hand-middle-metacarpal")).toBe(bodies[0]!.get("left-hand-middle-phalanx-metacarpal"));
    expect(bodies[0]!.get("tail")).toBeUndefined();
    expect(session.enabledFeatures).toContain("body-tracking");
  });

  it("is granted where it is required, and has no body where it was not asked for", async () => {
    install();
    const required = await enterHeadset([], ["body-tracking"]);
    expect(headset.frames(required.session, 1, ({ body }) => body?.size)).toEqual([83]);
    await required.session.end();
    const plain = await enterHeadset([]);
    expect(headset.frames(plain.session, 1, ({ body }) => body)).toEqual([null]);
    expect(plain.session.enabledFeatures).not.toContain("body-tracking");
  });

  it("points −Z of each joint along its bone, to the next joint", async () => {
    install();
    const { poses } = await enterHeadset();
    for (const chain of CHAINS) {
      const found = poses(1, chain).map((pose) => pose!);
      found.slice(1).forEach((next, k) => {
        const bone = between(place(found[k]!), place(next));
        const along = -dot(axis(found[k]!, 2), bone) / Math.hypot(...bone);
        expect(along, `${chain[k]} to ${chain[k + 1]}`).toBeGreaterThan(0.99999);
      });
    }
  });

  it("turns a hand as WebXR's own hand is turned, and has it where that is", async () => {
    install();
    headset.device.primaryInputMode = "hand";
    headset.device.hands.left?.position.set(0.1, 1.3, 0.2);
    headset.device.hands.right?.position.set(0.2, 1.3, -0.3);
    const { session, floor } = await enterHeadset();
    const apart = headset
      .frames(session, 2 * RATE, (frame) =>
        [...session.inputSources].flatMap(({ hand, handedness }) =>
          [...hand!.values()].map((joint) => {
            const name = `${handedness}-hand-${joint.jointName.replace("-finger", "").replace("pinky", "little")}`;
            const [ours, theirs] = [frame.getPose(frame.body!.get(name)!, floor)!, frame.getJointPose!(joint, floor)!];
            return { name, away: distance(ours, theirs), turned: degrees(ours, theirs) };
          }),
        ),
      )
      .at(-1)!;
    expect(apart.length).toBe(50);
    for (const { name, away, turned } of apart) {
      expect(away, name).toBeLessThan(name.endsWith("wrist") ? 0.001 : 0.016);
      expect(turned, name).toBeLessThan(name.endsWith("wrist") ? 0.1 : 30); // little fingers roll in the palm
    }
  });

  it("has the palm's side of hands below, soles below, and the front of the trunk where the wearer looks", async () => {
    install({ person: { height: 1.75 } });
    const { session, floor, poses } = await enterHeadset();
    const [forward] = headset.frames(session, RATE, (frame) => axis(frame.getViewerPose(floor)!, 2).map((v) => -v));
    for (const name of ["hips", "chest", "neck", "head"])
      expect(-dot(axis(poses(1, [name])[0]!, 1), forward as Place), name).toBeGreaterThan(0.8);
    for (const side of ["left", "right"]) {
      expect(axis(poses(1, [`${side}-foot-ball`])[0]!, 1)[1]).toBeGreaterThan(0.8);
      expect(dot(axis(poses(1, [`${side}-lower-leg`])[0]!, 1), forward as Place)).toBeGreaterThan(0.5);
    }
  });

  it("turns the far end of a forearm with the hand", async () => {
    install();
    const { left } = headset.device.controllers;
    const { poses } = await enterHeadset();
    for (const half of [0, 1]) {
      left?.quaternion.set(0, 0, Math.sin(half / 2), Math.cos(half / 2)); // about the forearm, which points ahead
      const [elbow, twist, wrist] = poses(RATE, ["left-arm-lower", "left-hand-wrist-twist", "left-hand-wrist"]);
      const roll = (base: XRPose) =>
        Math.abs(
          Math.atan2(dot(axis(wrist!, 1), axis(base, 0)), dot(axis(wrist!, 1), axis(base, 1))) * (180 / Math.PI),
        );
      expect(dot(axis(twist!, 2), axis(elbow!, 2))).toBeCloseTo(1, 6);
      expect(roll(elbow!)).toBeGreaterThan(30);
      expect(roll(twist!)).toBeLessThan(10);
    }
  });

  it("is under the headset, with hands at the controllers, feet on the floor and the given height", async () => {
    install({ person: { height: 1.85 } });
    const { device } = headset;
    device.position.set(3, 1.74, -2);
    device.controllers.left?.position.set(2.75, 1.1, -2.3);
    device.controllers.right?.position.set(3.25, 1.1, -2.3);
    const { session, floor, poses, pose } = await enterHeadset();
    const [head, hips, ankle] = poses(2 * RATE, ["head", "hips", "left-foot-ankle"]).map((found) => place(found!));
    expect(Math.hypot(head![0] - 3, head![2] + 2)).toBeLessThan(0.12);
    expect(Math.hypot(hips![0] - 3, hips![2] + 2)).toBeLessThan(0.4);
    expect(ankle![1]).toBeGreaterThan(0.03);
    expect(ankle![1]).toBeLessThan(0.2);
    device.controllers.left?.position.set(2.6, 1.4, -2.3);
    const wrist = pose(RATE, "left-hand-wrist");
    const [grip] = headset.frames(session, 1, (frame) => {
      const left = [...session.inputSources].find(({ handedness }) => handedness === "left")!;
      return frame.getPose(left.gripSpace!, floor)!;
    });
    expect(distance(wrist, grip!)).toBeLessThan(0.08);
    expect([wrist.emulatedPosition, pose(1, "hips").emulatedPosition]).toEqual([false, true]);
    const offsets = tracking!.person().restOffset!;
    const spine = ["pelvis", "spine1", "spine2", "spine3", "neck", "head", "head_top"];
    expect(spine.reduce((sum, name) => sum + offsets[3 * model.points.indexOf(name) + 1]!, 0)).toBeCloseTo(1.85, 2);
  });

  it("moves and turns as its wearer does", async () => {
    const names = ["hips", "left-foot-ball", "right-arm-lower", "right-hand-little-tip"];
    const turned = (yaw: number, [x, y, z]: Place): Place => [
      x * Math.cos(yaw) + z * Math.sin(yaw) + yaw,
      y,
      z * Math.cos(yaw) - x * Math.sin(yaw),
    ];
    const places = async (yaw: number) => {
      install();
      const { device } = headset;
      const parts: [{ position: { set: Function }; quaternion: { set: Function } }, Place][] = [
        [device, [0, 1.6, 0]],
        [device.controllers.left!, [-0.25, 1.3, -0.4]],
        [device.controllers.right!, [0.25, 1.1, -0.35]],
      ];
      for (const [part, at] of parts) {
        part.position.set(...turned(yaw, at));
        part.quaternion.set(0, Math.sin(yaw / 2), 0, Math.cos(yaw / 2));
      }
      const { session, poses } = await enterHeadset();
      const found = poses(RATE, names).map((pose) => place(pose!));
      await session.end();
      tracking?.uninstall();
      return found;
    };
    const [ahead, aside] = [await places(0), await places(2)];
    ahead.forEach((at, k) => expect(Math.hypot(...between(turned(2, at), aside[k]!)), names[k]).toBeLessThan(0.002));
  });
});

describe("poses of joints", () => {
  it("are the same seen from every space", async () => {
    install();
    const { session, floor } = await enterHeadset();
    const viewer = await session.requestReferenceSpace("viewer");
    const offset = new XRRigidTransform({ x: 1, y: 2, z: 3 }, { x: 0, y: Math.sin(0.4), z: 0, w: Math.cos(0.4) });
    const offsetSpace = floor.getOffsetReferenceSpace(offset.matrix as never); // iwer takes the matrix
    headset.frames(session, 1, (frame) => {
      const [hand, head] = ["left-hand-wrist", "head"].map((name) => frame.body!.get(name)!);
      const inFloor = frame.getPose(hand!, floor)!;
      for (const base of [viewer, offsetSpace, head!]) {
        const [from, seen] = [frame.getPose(base, floor)!, frame.getPose(hand!, base)!];
        const [x, y, z] = [0, 1, 2].map((k) => axis(from, k)) as [Place, Place, Place];
        const [a, b, c] = place(seen);
        const back = place(from).map((value, k) => value + a * x[k]! + b * y[k]! + c * z[k]!) as Place;
        expect(Math.hypot(...between(back, place(inFloor)))).toBeLessThan(1e-6);
        const axes = [0, 1, 2].map((k) => axis(seen, k));
        axes.forEach((v, k) => {
          const world = x.map((_, n) => v[0] * x[n]! + v[1] * y[n]! + v[2] * z[n]!) as Place;
          expect(dot(world, axis(inFloor, k))).toBeGreaterThan(1 - 1e-6);
        });
      }
      expect(Math.hypot(...place(frame.getPose(hand!, hand!)!))).toBeLessThan(1e-9);
      expect(frame.getPose(viewer, floor)!.transform.position.y).toBeCloseTo(1.6, 6); // the browser's own
    });
  });

  it("are written to an array by fillPoses, beside those of the browser's spaces", async () => {
    install();
    const { session, floor } = await enterHeadset();
    const viewer = await session.requestReferenceSpace("viewer");
    headset.frames(session, 1, (frame) => {
      const spaces = [viewer, frame.body!.get("hips")!];
      const frameOfAll = frame as typeof frame & { fillPoses(...values: unknown[]): boolean };
      const out = new Float32Array(32);
      expect(frameOfAll.fillPoses(spaces, floor, out)).toBe(true);
      expect([...out]).toEqual(spaces.flatMap((space) => [...frame.getPose(space, floor)!.transform.matrix]));
      expect(frameOfAll.fillPoses([viewer], floor, out)).toBe(true);
      expect(() => frameOfAll.fillPoses(spaces, floor, new Float32Array(31))).toThrow("31 numbers; give 32");
    });
  });

  it("are all null while the headset is not tracked, and come back", async () => {
    install();
    const { session, floor, poses } = await enterHeadset();
    const names = ["head", "hips", "left-hand-little-tip"];
    expect(poses(5, names).every(Boolean)).toBe(true);
    const lost = vi.spyOn(XRFrame.prototype, "getViewerPose").mockReturnValue(null as unknown as XRViewerPose);
    expect(poses(RATE / 2, names)).toEqual([null, null, null]);
    const filled = new Float32Array(16);
    headset.frames(session, 1, (frame) => {
      const { fillPoses } = frame as typeof frame & { fillPoses(...values: unknown[]): boolean };
      expect(fillPoses.call(frame, [frame.body!.get("hips")], floor, filled)).toBe(false);
    });
    expect(filled.every(Number.isNaN)).toBe(true);
    lost.mockRestore();
    const [head, hips] = poses(5, names).map((pose) => place(pose!));
    expect(head![1]).toBeGreaterThan(1.45);
    expect(hips![1]).toBeGreaterThan(0.7);
  });

  it("are those of the last animation frame in frames of events", async () => {
    install();
    const { session, floor, pose } = await enterHeadset();
    headset.frames(session, 1, () => null); // an animation frame without a request for the body
    const Frame = XRFrame as unknown as new (...values: unknown[]) => XRBodyFrame; // of iwer: session, id, active, animation
    const hips = () => {
      const frame = new Frame(session, 0, true, false, 0);
      return frame.getPose(frame.body!.get("hips")!, floor);
    };
    expect(hips()).toBeNull();
    const last = pose(1, "hips");
    expect(place(hips()!)).toEqual(place(last));
  });

  it("go on where controllers are lost, and go over to hands", async () => {
    install();
    const { device } = headset;
    const { session, floor, pose } = await enterHeadset();
    const before = pose(RATE, "left-hand-wrist");
    device.controllers.left!.connected = false;
    const lost = pose(2, "left-hand-wrist");
    expect(lost.emulatedPosition).toBe(true);
    expect(distance(lost, before)).toBeLessThan(0.02);
    device.primaryInputMode = "hand";
    device.hands.left?.position.set(0.1, 1.2, 0.1);
    const found = pose(RATE, "left-hand-wrist");
    expect(found.emulatedPosition).toBe(false);
    const [wrist] = headset.frames(session, 1, (frame) => {
      const { hand } = [...session.inputSources].find(({ handedness }) => handedness === "left")!;
      return frame.getJointPose!(hand!.get("wrist")!, floor)!;
    });
    expect(distance(found, wrist!)).toBeLessThan(0.01);
  });

  it("are those of further points that are given", async () => {
    const at: Place = [0.3, 0.5, -0.2];
    install({ points: () => [{ name: "left_ankle", position: at, accuracy: 0.005 }] });
    const { pose } = await enterHeadset();
    const ankle = pose(RATE, "left-foot-ankle");
    expect(ankle.emulatedPosition).toBe(false);
    expect(Math.hypot(...between(place(ankle), at))).toBeLessThan(0.03);
  });

  it("start anew on a recentred headset: the core's clock leaps", async () => {
    const [times, spaces]: [number[], EventTarget[]] = [[], []];
    const start: Model["start"] = (...known) => {
      const state = model.start(...known);
      return { ...state, step: (frame) => (times.push(frame.time), state.step(frame)) };
    };
    const { requestReferenceSpace } = XRSession.prototype;
    vi.spyOn(XRSession.prototype, "requestReferenceSpace").mockImplementation(async function (this: XRSession, kind) {
      const space = await requestReferenceSpace.call(this, kind);
      spaces.push(space);
      return space;
    } as XRSession["requestReferenceSpace"]);
    tracking = installBodyTracking({ ...model, start });
    const { pose } = await enterHeadset();
    pose(3, "hips");
    for (const space of spaces) space.dispatchEvent(new Event("reset"));
    pose(3, "hips");
    const steps = times.slice(1).map((time, k) => time - times[k]!);
    expect(steps.map((step) => step > 1)).toEqual([false, false, true, false, false]);
  });
});

describe("a page that was hidden", () => {
  it("goes on with the same motion where its wearer stayed", async () => {
    install({ person: { height: 1.75 } });
    const { poses } = await enterHeadset();
    const names = ["hips", "left-foot-ankle", "left-arm-lower", "chest"];
    const before = poses(3 * RATE, names);
    headset.wait(20);
    const after = poses(1, names);
    names.forEach((name, k) => expect(distance(before[k]!, after[k]!), name).toBeLessThan(0.03));
  });

  it("starts anew where its wearer went elsewhere", async () => {
    const times: number[] = [];
    const start: Model["start"] = (...known) => {
      const state = model.start(...known);
      return { ...state, step: (frame) => (times.push(frame.time), state.step(frame)) };
    };
    tracking = installBodyTracking({ ...model, start });
    const { pose } = await enterHeadset();
    pose(2, "hips");
    headset.wait(20);
    headset.device.position.set(2, 1.6, 0.2);
    pose(1, "hips");
    expect(times[2]! - times[1]!).toBeGreaterThan(10);
  });
});

describe("the polyfill", () => {
  it("keeps what it learned of the wearer for the next session, and closes what has ended", async () => {
    const closed: string[] = [];
    const start: Model["start"] = (person, settings) => {
      const state = model.start(person, settings);
      return { ...state, close: () => (closed.push("closed"), state.close()) };
    };
    tracking = installBodyTracking({ ...model, start });
    const first = await enterHeadset();
    first.poses(2 * RATE, ["hips"]);
    const learned = tracking.person();
    await first.session.end();
    expect(closed.length).toBe(1);
    expect(tracking.person().restOffset).toEqual(learned.restOffset);
    expect(learned.restOffset![1]).toBeGreaterThan(0.8);
    const second = await enterHeadset();
    expect(second.session).not.toBe(first.session);
    expect(second.pose(2, "hips")).not.toBeNull();
    await second.session.end();
    expect(closed.length).toBe(2);
  });

  it("goes on with what becomes known of the wearer", async () => {
    install();
    const { pose } = await enterHeadset();
    pose(RATE, "hips");
    tracking!.update({ height: 1.9 });
    pose(1, "hips");
    expect(tracking!.person().height).toBeCloseTo(1.9, 6);
  });

  it("refuses a wearer who cannot be, and leaves no session behind", async () => {
    install({ person: { height: 9 } });
    await expect(headset.enter()).rejects.toThrow("no person has");
    tracking!.update({ height: 1.7 });
    const { pose } = await enterHeadset(); // the headset is free
    expect(() => tracking!.update({ height: 9 })).toThrow("no person has");
    expect(pose(2, "hips")).not.toBeNull();
    expect(tracking!.person().height).toBeCloseTo(1.7, 6);
  });

  it("is taken back without a trace, also while a session runs", async () => {
    const names = ["body", "getPose", "fillPoses"];
    const before = names.map((name) => Object.getOwnPropertyDescriptor(XRFrame.prototype, name));
    install();
    const { session } = await enterHeadset();
    tracking!.uninstall();
    expect(names.map((name) => Object.getOwnPropertyDescriptor(XRFrame.prototype, name))).toEqual(before);
    expect([
      Object.hasOwn(navigator.xr!, "requestSession"),
      "XRBodySpace" in globalThis,
      "XRBody" in globalThis,
    ]).toEqual([false, false, false]);
    expect(headset.frames(session, 1, (frame) => frame.body)).toEqual([undefined]);
    await session.end();
    await expect(headset.enter([], ["body-tracking"])).rejects.toThrow("not supported");
  });

  it("leaves a body to a browser that has its own", async () => {
    const own = new Map([["hips", {}]]);
    Object.defineProperty(XRFrame.prototype, "body", { configurable: true, get: () => own });
    install();
    const { session } = await enterHeadset();
    expect(headset.frames(session, 1, ({ body }) => body)).toEqual([own]);
    tracking!.uninstall();
    expect(headset.frames(session, 1, ({ body }) => body)).toEqual([own]);
    Reflect.deleteProperty(XRFrame.prototype, "body");
  });

  it("says what is missing in a browser without WebXR", () => {
    vi.stubGlobal("navigator", {});
    expect(() => installBodyTracking(model)).toThrow("this browser has no WebXR; open the page by https");
  });
});
