/** The polyfill's body, read by Babylon.js's own body-tracking feature. */

import { Bone } from "@babylonjs/core/Bones/bone.js";
import { Skeleton } from "@babylonjs/core/Bones/skeleton.js";
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { Matrix, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Mesh } from "@babylonjs/core/Meshes/mesh.js";
import { Scene } from "@babylonjs/core/scene.js";
import { MixamoRigMapping, WebXRBodyJoint, WebXRBodyTracking } from "@babylonjs/core/XR/features/WebXRBodyTracking.js";
import { WebXRSessionManager } from "@babylonjs/core/XR/webXRSessionManager.js";
import { openModel } from "@bodysense/core";
import { installBodyTracking, type BodyTracking, type XRBodyFrame } from "@bodysense/core/webxr";
import { readFileSync } from "node:fs";
import { afterEach, beforeEach, expect, it, vi } from "vitest";
import { skeleton as tree } from "../body";
import { emulated, type Emulated } from "../emulated";

vi.setConfig({ testTimeout: 60_000 });

const bytes = (path: string) => new Uint8Array(readFileSync(new URL(path, import.meta.url)));
const OURS: Readonly<Record<string, string>> = {
  Hips: "pelvis",
  Spine: "spine1",
  Spine1: "spine2",
  Spine2: "spine3",
  Neck: "neck",
  Head: "head",
  ...Object.fromEntries(
    ["Left", "Right"].flatMap((side) =>
      Object.entries({
        Shoulder: "collar",
        Arm: "shoulder",
        ForeArm: "elbow",
        Hand: "wrist",
        UpLeg: "hip",
        Leg: "knee",
        Foot: "ankle",
        ToeBase: "foot",
      }).map(([bone, joint]) => [side + bone, `${side.toLowerCase()}_${joint}`]),
    ),
  ),
};

let headset: Emulated;
let tracking: BodyTracking;

beforeEach(async () => {
  headset = emulated();
  const weights = bytes("../../../src/bodysense/weights/completion.safetensors");
  tracking = installBodyTracking(await openModel(weights, bytes("../../core/core.wasm")), { person: { height: 1.75 } });
});
afterEach(() => {
  tracking.uninstall();
  vi.unstubAllGlobals();
  vi.restoreAllMocks();
});

/** Babylon's feature in a session of the emulated headset. */
async function enterHeadset(scene: Scene, options = {}) {
  const manager = new WebXRSessionManager(scene);
  await manager.initializeAsync();
  const feature = new WebXRBodyTracking(manager, options);
  const session = await manager.initializeSessionAsync("immersive-vr", {
    requiredFeatures: ["local-floor"],
    optionalFeatures: [feature.xrNativeFeatureName],
  });
  session.updateRenderState({ baseLayer: headset.layer(session) });
  const floor = await manager.setReferenceSpaceTypeAsync("local-floor");
  expect(feature.attach()).toBe(true);
  const look = <T>(count: number, read: (frame: XRBodyFrame) => T): T =>
    headset
      .frames(session, count, (frame) => {
        manager.onXRFrameObservable.notifyObservers(frame);
        return read(frame);
      })
      .at(-1)!;
  return { feature, floor, look };
}

it("is found by Babylon, whose joints are where the poses are", async () => {
  const scene = new Scene(new NullEngine());
  scene.useRightHandedSystem = true;
  const { feature, floor, look } = await enterHeadset(scene);
  const apart = look(5, (frame) =>
    WebXRBodyTracking.AllBodyJoints.map((name) => {
      const { x, y, z } = frame.getPose(frame.body!.get(name)!, floor)!.transform.position;
      return Vector3.Distance(feature.trackedBody!.getJointTransform(name)!.position, new Vector3(x, y, z));
    }),
  );
  expect(feature.isTracking).toBe(true);
  expect(feature.trackedBody!._lastDebugInfo).toContain("spaces:83 fillPoses: getPose:0/0 ok:true");
  expect(apart.length).toBe(83);
  expect(Math.max(...apart)).toBeLessThan(1e-5);
});

it("moves an avatar of Mixamo as the body moves", async () => {
  const scene = new Scene(new NullEngine());
  scene.useRightHandedSystem = true;
  const rig = new Skeleton("rig", "rig", scene);
  for (const [name, ours] of Object.entries(OURS)) {
    const point = tree.points.indexOf(ours);
    const parent = Object.keys(OURS).find((one) => OURS[one] === tree.points[tree.parents[point]!]) ?? null;
    const offset = Matrix.Translation(
      ...([0, 1, 2].map((k) => tree.restOffset[3 * point + k]!) as [number, number, number]),
    );
    new Bone(name, rig, parent ? rig.bones.find((bone) => bone.name === parent) : null, offset);
  }
  const mesh = new Mesh("mesh", scene);
  mesh.skeleton = rig;
  const { look, floor } = await enterHeadset(scene, { bodyMesh: mesh, isMixamoModel: true });
  expect(Object.values(MixamoRigMapping).every((name) => rig.bones.some((bone) => bone.name === name))).toBe(true);
  const limbs: readonly (readonly [WebXRBodyJoint, WebXRBodyJoint])[] = [
    [WebXRBodyJoint.LEFT_ARM_UPPER, WebXRBodyJoint.LEFT_ARM_LOWER],
    [WebXRBodyJoint.LEFT_ARM_LOWER, WebXRBodyJoint.LEFT_HAND_WRIST],
    [WebXRBodyJoint.RIGHT_ARM_UPPER, WebXRBodyJoint.RIGHT_ARM_LOWER],
    [WebXRBodyJoint.RIGHT_ARM_LOWER, WebXRBodyJoint.RIGHT_HAND_WRIST],
    [WebXRBodyJoint.LEFT_UPPER_LEG, WebXRBodyJoint.LEFT_LOWER_LEG],
    [WebXRBodyJoint.LEFT_LOWER_LEG, WebXRBodyJoint.LEFT_FOOT_ANKLE],
    [WebXRBodyJoint.RIGHT_UPPER_LEG, WebXRBodyJoint.RIGHT_LOWER_LEG],
  ];
  headset.device.controllers.left?.position.set(-0.2, 1.7, 0.1);
  const angles = look(40, (frame) => {
    rig.prepare(true);
    return limbs.map(([from, to]) => {
      const at = (name: WebXRBodyJoint) => {
        const { x, y, z } = frame.getPose(frame.body!.get(name)!, floor)!.transform.position;
        return new Vector3(x, y, z);
      };
      const bone = (name: WebXRBodyJoint) =>
        rig.bones
          .find((one) => one.name === MixamoRigMapping[name])!
          .getFinalMatrix()
          .getTranslation();
      const [seen, drawn] = [at(to).subtract(at(from)).normalize(), bone(to).subtract(bone(from)).normalize()];
      return (Math.acos(Math.min(1, Vector3.Dot(seen, drawn))) * 180) / Math.PI;
    });
  });
  expect(Math.max(...angles)).toBeLessThan(1);
});
