/** Draws the WebXR body of the wearer 1.5 m in front of them, facing them, also in browsers without body tracking. */

import { openModel } from "@bodysense/core";
import weights from "@bodysense/core/completion.safetensors?url";
import core from "@bodysense/core/core.wasm?url";
import { installBodyTracking, type XRBodyFrame } from "@bodysense/core/webxr";
import {
  ConeGeometry,
  GridHelper,
  HemisphereLight,
  InstancedMesh,
  Matrix4,
  MeshStandardMaterial,
  PerspectiveCamera,
  Scene,
  Vector3,
  WebGLRenderer,
} from "three";
import { VRButton } from "three/addons/webxr/VRButton.js";

const JOINTS = 83;
const BEFORE = new Matrix4().makeTranslation(0, 0, -1.5); // m
const TURNED = new Matrix4().makeRotationY(Math.PI);

const fetched = async (url: string) => new Uint8Array(await (await fetch(url)).arrayBuffer());
const model = await openModel(await fetched(weights), await fetched(core));
installBodyTracking(model, { person: { height: 1.75 } }); // m; leave it out to have it inferred

const scene = new Scene();
const camera = new PerspectiveCamera(60, innerWidth / innerHeight, 0.05, 50);
camera.position.set(0, 1.6, 0);
scene.add(new HemisphereLight(0xffffff, 0x666688, 3), new GridHelper(6, 12, 0x888888, 0xcccccc));

// A cone for each joint, its tip along the joint's −Z.
const cone = new ConeGeometry(0.02, 0.06, 8).rotateX(-Math.PI / 2);
const joints = new InstancedMesh(cone, new MeshStandardMaterial({ color: 0x3388ff }), JOINTS);
joints.frustumCulled = false;
joints.count = 0;
scene.add(joints);

const renderer = new WebGLRenderer({ antialias: true });
renderer.setClearColor(0xf4f4f0);
renderer.setSize(innerWidth, innerHeight);
renderer.xr.enabled = true;
const sessionInit = { optionalFeatures: ["body-tracking", "hand-tracking", "local-floor"] };
document.body.append(renderer.domElement, VRButton.createButton(renderer, sessionInit));

renderer.setAnimationLoop((_, frame?: XRFrame) => {
  const [space, body] = [renderer.xr.getReferenceSpace(), (frame as XRBodyFrame | undefined)?.body];
  joints.count = 0;
  for (const [name, joint] of body ?? []) {
    const pose = space && frame?.getPose(joint, space);
    if (!pose) continue; // all joints of a body are tracked, or none
    const size = name.includes("hand") ? 0.5 : 2;
    const place = new Matrix4().fromArray(pose.transform.matrix).scale(new Vector3(size, size, size));
    joints.setMatrixAt(joints.count++, place.premultiply(TURNED).premultiply(BEFORE));
  }
  joints.instanceMatrix.needsUpdate = true;
  renderer.render(scene, camera);
});
