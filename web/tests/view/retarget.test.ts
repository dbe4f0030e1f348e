import { Box3, Matrix4, Quaternion, Vector3 } from "three";
import { VRMHumanBoneList } from "@pixiv/three-vrm";
import { describe, expect, it } from "vitest";
import { Mirror } from "../../src/view/mirror";
import { boneOf, drivenJoints, localRotation } from "../../src/view/retarget";
import { place } from "../../src/body/skeleton";
import { Thrift } from "../../src/view/thrift";
import { moment, skeleton } from "../body";

const joints = skeleton.points.slice(0, skeleton.joints);

describe("bones of an avatar", () => {
  it("are VRM 1.0 bones, one for each of the 52 joints", () => {
    const bones = joints.map(boneOf);
    const known: readonly (string | null)[] = VRMHumanBoneList;
    expect(bones.filter((bone) => !known.includes(bone))).toEqual([]);
    expect(new Set(bones).size).toBe(52);
    expect(boneOf("head_top")).toBeNull();
  });

  it("turn as the body does, where the avatar lacks some", () => {
    const lacking = new Set(["upperChest", "neck", "leftToes"]);
    const driven = drivenJoints(skeleton, (bone) => !lacking.has(bone));
    expect(driven.length).toBe(52 - lacking.size);
    const body = place(skeleton, [0, 0, 0], moment(3, 0, 2).rotation);
    const world = new Map<number, Quaternion>([[-1, new Quaternion()]]);
    for (const bone of driven) {
      const [w, x, y, z] = localRotation(body, bone);
      const above = world.get(bone.above) ?? new Quaternion(NaN);
      world.set(bone.joint, above.clone().multiply(new Quaternion(x, y, z, w)));
      const [ww, wx, wy, wz] = body.rotation.subarray(4 * bone.joint);
      expect(Math.abs(world.get(bone.joint)?.dot(new Quaternion(wx, wy, wz, ww)) ?? 0)).toBeCloseTo(1, 5);
    }
  });
});

describe("the mirror", () => {
  it("stands 1.5 m before the wearer and shows them looking back", () => {
    const mirror = new Mirror();
    const yaw = new Quaternion().setFromAxisAngle(new Vector3(0, 1, 0), 0.7);
    mirror.standBefore([0.3, 1.6, -0.2], [yaw.w, yaw.x, yaw.y, yaw.z]);
    const head = new Vector3(0.3, 1.6, -0.2);
    const look = new Vector3(0, 0, -1).applyQuaternion(yaw);
    const image = head.clone().applyMatrix4(mirror.reflection());
    expect(image.distanceTo(head.clone().addScaledVector(look, 3))).toBeLessThan(1e-6);
    expect(new Matrix4().copy(mirror.reflection()).determinant()).toBeCloseTo(-1, 6);
  });

  it("reaches down to a lower floor, its upper edge and what it shows unchanged", () => {
    const mirror = new Mirror();
    const [before, map] = [new Box3().setFromObject(mirror.frame), mirror.reflection()];
    mirror.reachDown(-0.4);
    const after = new Box3().setFromObject(mirror.frame);
    expect(after.min.y - before.min.y).toBeCloseTo(-0.4, 6);
    expect(after.max.y).toBeCloseTo(before.max.y, 1);
    expect(mirror.reflection().equals(map)).toBe(true);
  });
});

describe("thrift", () => {
  const renderer = () => {
    const state = {
      shadowMap: { enabled: true },
      ratio: 2,
      getPixelRatio: () => state.ratio,
      setPixelRatio: (to: number) => (state.ratio = to),
    };
    return state;
  };
  const thriftOf = (of: ReturnType<typeof renderer>, isFast: boolean) =>
    new Thrift(of as unknown as ConstructorParameters<typeof Thrift>[0], isFast);
  const run = (of: ReturnType<typeof renderer>, took: number, frames: number) => {
    const thrift = thriftOf(of, true);
    for (let k = 1; k <= frames; k++) thrift.frame(k * took);
  };

  it("gives up nothing at 60 Hz, shadows first where it is slow, then pixels", () => {
    const [fast, slow, slower] = [renderer(), renderer(), renderer()];
    run(fast, 16, 200);
    run(slow, 60, 21);
    run(slower, 60, 200);
    expect([fast.shadowMap.enabled, fast.ratio]).toEqual([true, 2]);
    expect([slow.shadowMap.enabled, slow.ratio]).toEqual([false, 2]);
    expect([slower.shadowMap.enabled, slower.ratio]).toEqual([false, 0.4]);
    const slowest = renderer();
    run(slowest, 600, 5);
    expect(slowest.shadowMap.enabled).toBe(false);
  });

  it("draws seldom and small from the beginning where no graphics card draws", () => {
    const of = renderer();
    const thrift = thriftOf(of, false);
    expect([of.shadowMap.enabled, of.ratio]).toEqual([false, 0.6]); // pixels for one of the page
    expect([100, 116, 132, 151].map((milliseconds) => thrift.isDue(milliseconds))).toEqual([true, false, false, true]);
    expect([100, 116].map((milliseconds) => thriftOf(of, true).isDue(milliseconds))).toEqual([true, true]);
  });
});
