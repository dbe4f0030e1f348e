import {
  Bone,
  BoxGeometry,
  BufferAttribute,
  Group,
  Quaternion,
  Skeleton as Armature,
  SkinnedMesh,
  Vector3,
  type Object3D,
} from "three";
import type { GLTF } from "three/addons/loaders/GLTFLoader.js";
import { describe, expect, it } from "vitest";
import { place } from "../../src/body/skeleton";
import { avatarOfGlb, isFigure } from "../../src/files/glb_person";
import { moment, numbers, skeleton } from "../body";

const MIXAMO: Readonly<Record<string, string>> = {
  pelvis: "Hips",
  spine1: "Spine",
  spine2: "Spine1",
  spine3: "Spine2",
  neck: "Neck",
  head: "Head",
  ...Object.fromEntries(
    ["left", "right"].flatMap((side) =>
      Object.entries({
        collar: "Shoulder",
        shoulder: "Arm",
        elbow: "ForeArm",
        wrist: "Hand",
        hip: "UpLeg",
        knee: "Leg",
        ankle: "Foot",
      }).map(([joint, name]) => [`${side}_${joint}`, (side === "left" ? "Left" : "Right") + name]),
    ),
  ),
};
const BONES = ["left", "right"].flatMap((side) =>
  [
    ["hip", "knee"],
    ["knee", "ankle"],
    ["shoulder", "elbow"],
    ["elbow", "wrist"],
  ].map((pair) => pair.map((part) => `${side}_${part}`)),
);

/** A figure of centimetres with hanging arms, whose bones have axes of their own, in a file whose armature is turned. */
function figure(rename = (name: string): string => `mixamorig:${name}`): GLTF {
  const local = Float32Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
  for (const [side, sign] of [
    ["left", -1],
    ["right", 1],
  ] as const)
    local.set([Math.cos(0.4), 0, 0, sign * Math.sin(0.4)], 4 * skeleton.points.indexOf(`${side}_shoulder`));
  const rest = place(skeleton, [0, 1, 0], local);
  const next = numbers(3);
  const armature = new Group();
  armature.rotation.x = -Math.PI / 2;
  armature.scale.setScalar(0.01);
  const scene = new Group();
  scene.add(armature);
  const bones = new Map<number, Object3D>();
  for (let joint = 0; joint < skeleton.joints; joint++) {
    const name = MIXAMO[skeleton.points[joint]];
    if (!name) continue;
    const bone = new Bone();
    bone.userData["name"] = rename(name);
    scene.add(bone);
    bone.position.fromArray(rest.position, 3 * joint);
    bone.quaternion.copy(new Quaternion(next(), next(), next(), next()).normalize());
    bone.updateMatrixWorld(true);
    let above = skeleton.parents[joint];
    while (above >= 0 && !bones.has(above)) above = skeleton.parents[above];
    (bones.get(above) ?? armature).attach(bone);
    bones.set(joint, bone);
  }
  scene.add(skinOf([...bones.values()] as Bone[]));
  return { scene, animations: [] } as unknown as GLTF;
}

/** A box that follows the first bone; its lowest corner is 1 m under the floor. */
function skinOf(bones: Bone[]): SkinnedMesh {
  const geometry = new BoxGeometry(0.4, 2, 0.4);
  const count = geometry.getAttribute("position").count;
  geometry.setAttribute("skinIndex", new BufferAttribute(new Uint8Array(4 * count), 4));
  const weights = Float32Array.from({ length: 4 * count }, (_, k) => (k % 4 === 0 ? 1 : 0));
  geometry.setAttribute("skinWeight", new BufferAttribute(weights, 4));
  const skin = new SkinnedMesh(geometry);
  skin.bind(new Armature(bones));
  return skin;
}

describe("a person who is no VRM", () => {
  it("stands and points as the body does, whatever its rest pose, axes and units are", () => {
    const file = figure();
    expect(isFigure(file)).toBe(true);
    const avatar = avatarOfGlb(file, "person.glb", skeleton);
    const nodes = new Map<string, Object3D>();
    avatar.group.traverse((node) => nodes.set(String(node.userData["name"]).replace("mixamorig:", ""), node));
    for (const number of [1, 2]) {
      const { body } = moment(number, 0);
      avatar.show(body, skeleton, 0);
      avatar.group.updateMatrixWorld(true);
      for (const [start, end] of BONES) {
        const [from, to] = [start, end].map(
          (joint) => nodes.get(MIXAMO[joint])?.getWorldPosition(new Vector3()) ?? new Vector3(),
        );
        const [a, b] = [start, end].map((joint) =>
          new Vector3().fromArray(body.position, 3 * skeleton.points.indexOf(joint)),
        );
        expect(to.sub(from).normalize().dot(b.sub(a).normalize()), `${start} to ${end}`).toBeGreaterThan(0.9999);
      }
      const hips = nodes.get("Hips")?.getWorldPosition(new Vector3());
      expect(hips?.distanceTo(new Vector3().fromArray(body.position))).toBeLessThan(1e-3);
    }
  });

  it("is distinguished from a motion, and needs joints of a person", () => {
    const file = figure((name) => name.replace("UpLeg", "Wheel"));
    expect(isFigure({ ...file, animations: [{}] } as unknown as GLTF)).toBe(false);
    expect(() => avatarOfGlb(file, "car.glb", skeleton)).toThrow(
      /^car\.glb is no person that this page knows[^\n]*hip/,
    );
  });
});
