import { Vector3 } from "three";
import { describe, expect, it } from "vitest";
import { Avatar, readGlb } from "../src/view/avatar";
import { boneOf } from "../src/view/retarget";
import { place } from "../src/body/skeleton";
import { moment, skeleton } from "./body";
import { vrmBytes } from "./vrm_file.mjs";

function bytes(content: Buffer): ArrayBuffer {
  return Uint8Array.from(content).buffer;
}

async function read(content: Buffer, name: string): Promise<Avatar> {
  const avatar = Avatar.of(await readGlb(bytes(content), name), name);
  if (!avatar) throw new Error("no avatar");
  return avatar;
}

describe("an avatar", () => {
  it.each(["1", "0"] as const)("of VRM %s stands as the body does", async (version) => {
    const avatar = await read(vrmBytes(boneOf, version), "boxes.vrm");
    const { rootPosition, rotation } = moment(4, 0);
    const body = place(skeleton, rootPosition, rotation);
    avatar.show(body, skeleton, 0);
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
    const avatar = await read(vrmBytes(some), "boxes.vrm");
    const still = Float32Array.from({ length: 4 * skeleton.joints }, (_, k) => (k % 4 === 0 ? 1 : 0));
    const body = place(skeleton, [0, 1, 0], still);
    avatar.show(body, skeleton, 0);
    avatar.group.updateMatrixWorld(true);
    const wrist = skeleton.points.indexOf("left_wrist");
    const there = avatar.group.getObjectByName("left_wrist")?.getWorldPosition(new Vector3());
    expect(there?.distanceTo(new Vector3().fromArray(body.position, 3 * wrist))).toBeLessThan(1e-4);
  });

  it("is refused in one line where its file is damaged or no VRM", async () => {
    const whole = vrmBytes(boneOf);
    await expect(read(whole.subarray(0, 2000), "cut.vrm")).rejects.toThrow(
      /^cut\.vrm is damaged \([^\n]*\); export it again\.$/,
    );
    const plain = Buffer.from(whole.toString("latin1").replaceAll("VRMC_vrm", "VRMC_xyz"), "latin1");
    await expect(read(plain, "plain.vrm")).rejects.toThrow(/^plain\.vrm is no VRM: it names no humanoid bones/);
  });
});
