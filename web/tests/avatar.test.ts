import { Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { Avatar } from "../src/avatar";
import { boneOf } from "../src/retarget";
import { place } from "../src/skeleton";
import { pose, skeleton } from "./body";
import { vrmBytes } from "./vrm_file.mjs";

function bytes(content: Buffer): ArrayBuffer {
  return Uint8Array.from(content).buffer;
}

describe("an avatar", () => {
  it.each(["1", "0"] as const)("of VRM %s stands as the body does", async (version) => {
    const avatar = await Avatar.read(bytes(vrmBytes(boneOf, version)), "boxes.vrm", skeleton);
    const { rootPosition, rotation } = pose(4, 0);
    const body = place(skeleton, rootPosition, rotation);
    avatar.show(body, 0);
    avatar.group.updateMatrixWorld(true);
    for (let joint = 0; joint < skeleton.joints; joint++) {
      const node = avatar.group.getObjectByName(skeleton.points[joint]);
      const there = node?.getWorldPosition(new Vector3());
      expect(there?.distanceTo(new Vector3().fromArray(body.position, 3 * joint)), skeleton.points[joint]).toBeLessThan(
        1e-4,
      );
    }
  });

  it("without optional bones keeps its hands where they belong", async () => {
    const lacking = new Set(["upperChest", "neck", "leftShoulder", "rightShoulder"]);
    const some = (joint: string): string | null => (lacking.has(boneOf(joint) ?? "") ? null : boneOf(joint));
    const avatar = await Avatar.read(bytes(vrmBytes(some)), "boxes.vrm", skeleton);
    const still = Float32Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
    const body = place(skeleton, [0, 1, 0], still);
    avatar.show(body, 0);
    avatar.group.updateMatrixWorld(true);
    const wrist = skeleton.points.indexOf("left_wrist");
    const there = avatar.group.getObjectByName("left_wrist")?.getWorldPosition(new Vector3());
    expect(there?.distanceTo(new Vector3().fromArray(body.position, 3 * wrist))).toBeLessThan(1e-4);
  });

  it("is refused in one line where its file is damaged or no VRM", async () => {
    const whole = vrmBytes(boneOf);
    await expect(Avatar.read(bytes(whole.subarray(0, 2000)), "cut.vrm", skeleton)).rejects.toThrow(
      /^cut\.vrm is damaged \([^\n]*\); export it again\.$/,
    );
    const plain = Buffer.from(whole.toString("latin1").replaceAll("VRMC_vrm", "VRMC_xyz"), "latin1");
    await expect(Avatar.read(bytes(plain), "plain.vrm", skeleton)).rejects.toThrow(
      /^plain\.vrm is a glTF file but no VRM/,
    );
  });
});
