import { Bone, Vector3 } from "three";
import { BVHLoader } from "three/addons/loaders/BVHLoader.js";
import { AnimationMixer } from "three";
import { describe, expect, it } from "vitest";
import { avatarBytes } from "../src/avatar_file";
import { bvhText, eulerZXY } from "../src/bvh";
import { History } from "../src/history";
import { resample } from "../src/resample";
import { place } from "../src/skeleton";
import { numbers, pose, skeleton } from "./body";

function motion(times: readonly number[]) {
  const history = new History(skeleton);
  times.forEach((time, sequence) => history.addPose(pose(sequence, time), 0));
  return { history, motion: resample(history.longestRun(), skeleton.joints) };
}

describe("resampling", () => {
  it("keeps frames that are even already", () => {
    const { history, motion: even } = motion([1, 1.05, 1.1, 1.15]);
    expect([even.rate, even.frames]).toEqual([20, 4]);
    history.moments.forEach(({ pose: { rotation } }, frame) => {
      const there = even.rotation.subarray(frame * rotation.length, (frame + 1) * rotation.length);
      for (let k = 0; k < rotation.length; k++) expect(there[k]).toBeCloseTo(rotation[k], 4);
    });
  });

  it("gives unit rotations and a steady rate where frames are missing", () => {
    const { motion: even } = motion([0, 0.05, 0.1, 0.25, 0.3]);
    expect([even.rate, even.frames]).toEqual([20, 7]);
    for (let at = 0; at < even.rotation.length; at += 4) {
      expect(Math.hypot(...even.rotation.subarray(at, at + 4))).toBeCloseTo(1, 5);
    }
  });
});

describe("BVH", () => {
  it("is read by three.js' loader as the same motion", () => {
    const { history, motion: even } = motion([0, 0.05, 0.1]);
    const { skeleton: read, clip } = new BVHLoader().parse(bvhText(skeleton, even));
    const mixer = new AnimationMixer(read.bones[0]);
    mixer.clipAction(clip).play();
    expect(clip.duration).toBeCloseTo(0.1, 4);
    history.moments.slice(0, 2).forEach(({ pose: { rootPosition, rotation } }, frame) => {
      mixer.setTime(frame * 0.05);
      read.bones[0].updateMatrixWorld(true);
      const wanted = place(skeleton, rootPosition, rotation);
      const named = new Map(read.bones.map((bone: Bone) => [bone.name, bone]));
      for (let joint = 0; joint < skeleton.joints; joint++) {
        const there = named.get(skeleton.points[joint])?.getWorldPosition(new Vector3()).divideScalar(100);
        expect(there?.distanceTo(new Vector3().fromArray(wanted.position, 3 * joint))).toBeLessThan(1e-3);
      }
    });
  });

  it("finds angles also where the middle one is a right angle", () => {
    const next = numbers(5);
    for (let k = 0; k < 50; k++) {
      const middle = k < 5 ? Math.PI / 2 : (Math.PI / 2) * next();
      const angles: [number, number, number] = [3 * next(), middle, 3 * next()];
      const found = eulerZXY(fromEuler(angles));
      const [a, b] = [fromEuler(angles), fromEuler(found)];
      expect(Math.abs(a.reduce((sum, value, i) => sum + value * b[i], 0))).toBeCloseTo(1, 6);
    }
  });
});

/** wxyz of Rz · Rx · Ry. */
function fromEuler([z, x, y]: readonly [number, number, number]): number[] {
  const [cz, sz, cx, sx, cy, sy] = [z, x, y].flatMap((angle) => [Math.cos(angle / 2), Math.sin(angle / 2)]);
  return [
    cz * cx * cy - sz * sx * sy,
    cz * sx * cy - sz * cx * sy,
    cz * cx * sy + sz * sx * cy,
    sz * cx * cy + cz * sx * sy,
  ];
}

describe("an avatar's file", () => {
  const file = (content: Uint8Array<ArrayBuffer>, name: string) => Object.assign(new Blob([content]), { name });

  it("is refused in one line where it is none", async () => {
    await expect(avatarBytes(file(new TextEncoder().encode("just a text, longer than that"), "a.vrm"))).rejects.toThrow(
      /^a\.vrm is no VRM avatar; drop a \.vrm file[^\n]*$/,
    );
    await expect(avatarBytes(file(new Uint8Array(3), "short.vrm"))).rejects.toThrow(/is no VRM avatar/);
  });

  it("is refused before it is read where it is too large", async () => {
    const unread = () => Promise.reject(new Error("was read"));
    const large = {
      name: "b.vrm",
      size: 2e9,
      arrayBuffer: unread,
      slice: () => ({ arrayBuffer: unread }) as unknown as Blob,
    };
    await expect(avatarBytes(large)).rejects.toThrow("b.vrm has 2000 MB; an avatar may have 200 MB");
  });

  it("passes with glTF's first bytes", async () => {
    const bytes = new Uint8Array(20);
    bytes.set(new TextEncoder().encode("glTF"));
    expect((await avatarBytes(file(bytes, "c.vrm"))).byteLength).toBe(20);
  });
});
