/** The headset source, driven by frames of a fake WebXR session. */

import { Group, Scene, Vector3 } from "three";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { axisAngle, rotate, type Quaternion, type Vector } from "../../src/body/math";
import type { Observation } from "../../src/body/observation";
import type { Live } from "../../src/live";
import { Headset, missingForHeadset } from "../../src/sources/headset";
import type { View } from "../../src/view/scene";
import { VrMenu } from "../../src/view/vr_menu";
import { skeleton } from "../body";

class FakeSession extends EventTarget {
  readonly inputSources: object[] = [{ handedness: "left", gripSpace: "left", targetRaySpace: "ray" }];
  end(): Promise<void> {
    this.dispatchEvent(new Event("end"));
    return Promise.resolve();
  }
}

function poseAt([x, y, z]: Vector, [w, a, b, c]: Quaternion = [1, 0, 0, 0]) {
  const matrix = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, x, y, z, 1];
  return {
    transform: { position: { x, y, z }, orientation: { w, x: a, y: b, z: c }, matrix },
    emulatedPosition: false,
  };
}

async function enterHeadset() {
  const session = new FakeSession();
  const tracked: Observation[] = [];
  const left: boolean[] = [];
  const pressed: string[] = [];
  const space = Object.assign(new EventTarget(), {});
  const view = {
    scene: new Scene(),
    stage: new Group(),
    renderer: { xr: { getReferenceSpace: () => space, setSession: () => Promise.resolve() } },
    reset: vi.fn(),
    lightAt: vi.fn(),
    floorAt: vi.fn(),
    showRoom: vi.fn(),
  };
  vi.stubGlobal("navigator", { xr: { requestSession: () => Promise.resolve(session) } });
  const menu = new VrMenu(["first", "second"].map((id) => ({ text: () => id, press: () => pressed.push(id) })));
  const live = { skeleton, tree: skeleton } as Live;
  const headset = new Headset(view as unknown as View, live, menu, {
    tracked: (observation) => tracked.push(observation),
    left: (wasRequested) => left.push(wasRequested),
  });
  await headset.enter("immersive-vr");
  const frame = (milliseconds: number, head: Vector, turn: Quaternion) =>
    headset.frame(milliseconds, {
      getViewerPose: () => poseAt(head, turn),
      getPose: () => poseAt([0, 1.2, 0]),
    } as unknown as XRFrame);
  return { session, tracked, left, pressed, view, menu, headset, frame };
}

beforeEach(() => {
  vi.stubGlobal("document", { createElement: () => ({ getContext: () => null }) });
});
afterEach(() => vi.unstubAllGlobals());

const headOf = ({ points }: Observation) => points.find(({ name }) => name === "head");

describe("a headset", () => {
  it("has its wearer in the middle and facing the front from the first frame, wherever they stand", async () => {
    const { tracked, frame } = await enterHeadset();
    frame(1000, [2, 1.65, -3], axisAngle([0, 1, 0], 2.2));
    const head = headOf(tracked[0]);
    const [x, , z] = rotate(head?.rotation ?? [1, 0, 0, 0], [0, 0, 1]);
    expect(Math.atan2(x, z)).toBeCloseTo(0, 6);
    expect(Math.hypot(head?.position?.[0] ?? 9, head?.position?.[2] ?? 9)).toBeCloseTo(0, 6);
    expect(tracked[0].points.map(({ name }) => name)).toEqual(["head", "left_wrist"]);
  });

  it("is placed again when it is recentred, and its clock jumps to restart the motion", async () => {
    const { tracked, headset, frame } = await enterHeadset();
    frame(1000, [0, 1.6, 0], [1, 0, 0, 0]);
    frame(1014, [1, 1.6, 0], [1, 0, 0, 0]);
    headset.recentre();
    frame(1028, [1, 1.6, 0], [1, 0, 0, 0]);
    expect(Math.abs(headOf(tracked[1])?.position?.[0] ?? 0)).toBeCloseTo(1, 6);
    expect(headOf(tracked[2])?.position?.[0]).toBeCloseTo(0, 6);
    expect(tracked[2].time - tracked[1].time).toBeGreaterThan(1);
  });

  it("raises somebody who sits to where their head stands", async () => {
    const { tracked, headset, frame } = await enterHeadset();
    frame(1000, [0, 1.15, 0], [1, 0, 0, 0]);
    headset.sit(true);
    frame(1014, [0, 1.15, 0], [1, 0, 0, 0]);
    const standing = headOf(tracked[1])?.position?.[1] ?? 0;
    expect(standing).toBeGreaterThan(1.4);
    headset.sit(false);
    frame(1028, [0, 1.15, 0], [1, 0, 0, 0]);
    expect(headOf(tracked[2])?.position?.[1]).toBeLessThan(1.2);
  });

  it("raises a wearer marked as seated before the first frame, and lets them stand up", async () => {
    const { tracked, headset, frame } = await enterHeadset();
    headset.sit(true);
    for (const [k, height] of [1.15, 1.3, 1.5, 1.6, 1.1].entries()) frame(1000 + 14 * k, [0, height, 0], [1, 0, 0, 0]);
    const heights = tracked.map((observation) => headOf(observation)?.position?.[1] ?? 0);
    for (const height of heights.slice(0, 4)) expect(height).toBeCloseTo(heights[0], 1); // standing all the while
    expect(heights[0]).toBeGreaterThan(1.4);
    expect(heights[4]).toBeCloseTo(heights[0] - 0.05, 2); // bowed in the seat
  });

  it("draws the floor under the feet of somebody who sits, while they rise and after they leave", async () => {
    const { view, session, headset, frame } = await enterHeadset();
    headset.sit(true);
    const floor = () => view.floorAt.mock.lastCall?.[0] as number;
    for (const [k, height] of [1.15, 1.3, 1.5].entries()) {
      frame(1000 + 14 * k, [0, height, 0], [1, 0, 0, 0]);
      expect(floor()).toBeLessThan(-0.05);
      expect(new Vector3().applyMatrix4(view.stage.matrix).y).toBeCloseTo(floor(), 6); // the mirrored body's own floor
    }
    await session.end();
    expect(floor()).toBe(0);
  });

  it("keeps its mirror as the wearer left it, from session to session", async () => {
    const { view, session, headset } = await enterHeadset();
    const mirror = view.scene.children[0];
    for (const isVisible of [false, false, true]) {
      headset.showMirror(isVisible);
      await session.end();
      expect([mirror.visible, view.stage.visible]).toEqual([false, true]); // the page shows the body
      await headset.enter("immersive-vr");
      expect([mirror.visible, view.stage.visible, headset.isMirrorVisible]).toEqual(Array(3).fill(isVisible));
    }
  });

  it("takes no hand from a transient pointer", async () => {
    const { tracked, frame, session } = await enterHeadset();
    Object.assign(session.inputSources[0] ?? {}, { targetRayMode: "transient-pointer" });
    frame(1000, [0, 1.6, 0], [1, 0, 0, 0]);
    expect(tracked[0].points.map(({ name }) => name)).toEqual(["head"]);
  });

  it("restores camera and stage when it ends, and reports whether the user ended it", async () => {
    const requested = await enterHeadset();
    requested.frame(1000, [0, 1.6, 0], [1, 0, 0, 0]);
    expect(requested.view.stage.matrixAutoUpdate).toBe(false);
    requested.headset.stop();
    expect([requested.left, requested.view.stage.matrixAutoUpdate]).toEqual([[true], true]);
    expect(requested.view.reset).toHaveBeenCalledOnce();
    const lost = await enterHeadset();
    await lost.session.end();
    expect(lost.left).toEqual([false]);
  });

  it("presses the item of its menu that a ray points at", async () => {
    const { menu, pressed, frame } = await enterHeadset();
    frame(1000, [0, 1.6, 0], [1, 0, 0, 0]);
    menu.board.updateMatrixWorld(true);
    const ray = menu.board.matrixWorld.clone();
    ray.multiply(ray.clone().makeTranslation(0, -0.03, 1)); // a metre before the board, a little below its middle
    expect(menu.press(ray)).toBe(true);
    expect(pressed).toEqual(["first"]);
    expect(menu.press(ray.makeTranslation(9, 9, 9))).toBe(false);
  });
});

describe("what is missing for a headset", () => {
  it.each([
    [false, {}, /^A headset needs a safe address: [^\n]*https[^\n]*$/],
    [true, {}, /^This browser has no WebXR: [^\n]*$/],
    [true, { xr: { isSessionSupported: () => Promise.resolve(false) } }, /^No headset answers: [^\n]*$/],
  ])("is reported in one sentence (secure: %s, %o)", async (isSecure, navigator, sentence) => {
    vi.stubGlobal("isSecureContext", isSecure);
    vi.stubGlobal("navigator", navigator);
    expect(await missingForHeadset()).toMatch(sentence);
  });

  it("is nothing where a headset answers", async () => {
    vi.stubGlobal("isSecureContext", true);
    vi.stubGlobal("navigator", { xr: { isSessionSupported: () => Promise.resolve(true) } });
    expect(await missingForHeadset()).toBeNull();
  });
});
