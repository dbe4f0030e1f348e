/** WebXR's body in Node, by the installed package, on a headset of three poses: node webxr.mjs prints joints. */

import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { openModel } from "@bodysense/core";
import { installBodyTracking } from "@bodysense/core/webxr";

const weights = readFileSync(createRequire(import.meta.url).resolve("@bodysense/core/completion.safetensors"));
const model = await openModel(weights);
const missing = () => {
  try {
    installBodyTracking(model);
  } catch (error) {
    return error.message;
  }
};
const refused = missing();

const upright = { x: 0, y: 0, z: 0, w: 1 };
const at = (x, y, z) => ({ transform: { position: { x, y, z }, orientation: upright }, emulatedPosition: false });
globalThis.XRRigidTransform = class {
  constructor(position, orientation) {
    Object.assign(this, { position, orientation });
  }
};
globalThis.XRFrame = class {
  constructor(session) {
    this.session = session;
  }
  getViewerPose = () => at(0, 1.6, 0);
  getPose(space) {
    return { left: at(-0.25, 1, -0.3), right: at(0.25, 1, -0.3) }[space] ?? at(0, 0, 0);
  }
};
class Session extends EventTarget {
  inputSources = ["left", "right"].map((side) => ({ handedness: side, gripSpace: side }));
  enabledFeatures = ["local-floor"];
  requestReferenceSpace = () => Promise.resolve(new EventTarget());
  requestAnimationFrame(call) {
    call(1000, new XRFrame(this));
  }
}
const xr = { requestSession: () => Promise.resolve(new Session()) };
Object.defineProperty(globalThis, "navigator", { value: { xr }, configurable: true });

installBodyTracking(model, { person: { height: 1.75 } });
const session = await navigator.xr.requestSession("immersive-vr", { optionalFeatures: ["body-tracking"] });
const floor = await session.requestReferenceSpace("local-floor");
session.requestAnimationFrame((_, frame) => {
  const joints = [...frame.body].map(([name, joint]) => {
    const { x, y, z } = frame.getPose(joint, floor).transform.position;
    return [name, [x, y, z]];
  });
  console.log(JSON.stringify({ refused, joints: Object.fromEntries(joints) }));
});
