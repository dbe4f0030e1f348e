/** A headset that iwer emulates in Node: no picture, and a clock that the test moves. */

import type { XRBodyFrame } from "@bodysense/core/webxr";
import { metaQuest3, XRDevice } from "iwer";
import { vi } from "vitest";

export const RATE = 72; // Hz
const START = 1000; // ms, on the clock

/** Stands for canvas, context and document, of which nothing is wanted. */
const anything: unknown = new Proxy(function () {}, {
  get: (_, key) => (key === Symbol.toPrimitive ? () => 0 : anything),
  set: () => true,
  apply: () => anything,
  construct: () => anything as object,
});

class Place {
  constructor(
    readonly x = 0,
    readonly y = 0,
    readonly z = 0,
    readonly w = 1,
  ) {}
  static fromPoint = ({ x, y, z, w }: DOMPointInit) => new Place(x, y, z, w);
}

export interface Emulated {
  readonly device: XRDevice;
  /** Enter VR. */
  enter(features?: string[], required?: string[]): Promise<XRSession>;
  /** A layer without a picture, so that frames come. */
  layer(session: XRSession): XRWebGLLayer;
  /** Return the results of `look` for `count` animation frames of a session. */
  frames<T>(session: XRSession, count: number, look: (frame: XRBodyFrame) => T): T[];
  /** Let time pass without frames. */
  wait(seconds: number): void;
}

/** Put the headset on; `vi.unstubAllGlobals` takes it off. */
export function emulated(): Emulated {
  const waiting: FrameRequestCallback[] = [];
  let now = START;
  vi.spyOn(performance, "now").mockImplementation(() => now);
  vi.stubGlobal("requestAnimationFrame", (call: FrameRequestCallback) => waiting.push(call));
  vi.stubGlobal("cancelAnimationFrame", () => undefined);
  vi.stubGlobal("document", anything);
  vi.stubGlobal("window", anything);
  vi.stubGlobal("navigator", {});
  vi.stubGlobal("DOMPointReadOnly", Place);
  vi.stubGlobal("localStorage", { getItem: () => null });
  vi.stubGlobal("WebGL2RenderingContext", class {});
  const device = new XRDevice(metaQuest3);
  device.installRuntime({ forceInstall: true });
  device.position.set(0.4, 1.6, 0.2);
  device.controllers.left?.position.set(0.15, 1.05, -0.1);
  device.controllers.right?.position.set(0.65, 1.05, -0.1);
  const layer = (session: XRSession) => new XRWebGLLayer(session, anything as WebGL2RenderingContext);
  return {
    device,
    layer,
    wait: (seconds) => void (now += 1000 * seconds),
    async enter(features = ["body-tracking"], required = []) {
      const init = { requiredFeatures: ["local-floor", ...required], optionalFeatures: features };
      const session = await navigator.xr!.requestSession("immersive-vr", init);
      session.updateRenderState({ baseLayer: layer(session) });
      return session;
    },
    frames<T>(session: XRSession, count: number, look: (frame: XRBodyFrame) => T) {
      return Array.from({ length: count }, () => {
        const seen: T[] = [];
        session.requestAnimationFrame((_, frame) => seen.push(look(frame as XRBodyFrame)));
        now += 1000 / RATE;
        for (const call of waiting.splice(0)) call(now);
        if (seen.length !== 1) throw new Error(`${seen.length} frames came; look into the console`);
        return seen[0]!;
      });
    },
  };
}
