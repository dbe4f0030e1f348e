import { Bone, Vector3 } from "three";
import { BVHLoader } from "three/addons/loaders/BVHLoader.js";
import { AnimationMixer } from "three";
import { validateBytes } from "gltf-validator";
import { describe, expect, it, vi } from "vitest";
import { History } from "../../src/takes/history";
import { bvhText, eulerZXY } from "../../src/out/bvh";
import { glbBytes, vrmaBytes } from "../../src/out/glb";
import { resample } from "../../src/out/resample";
import { place } from "../../src/body/skeleton";
import { moment, numbers, skeleton } from "../body";

/** three.js' exporter reads blobs as browsers do. */
class Reader {
  result: ArrayBuffer | null = null;
  onloadend: (() => void) | null = null;
  readAsArrayBuffer(blob: Blob): void {
    void blob.arrayBuffer().then((bytes) => {
      this.result = bytes;
      this.onloadend?.();
    });
  }
}
vi.stubGlobal("FileReader", Reader);

function motion(times: readonly number[]) {
  const history = new History();
  times.forEach((time, number) => history.add(moment(number, time)));
  return { history, motion: resample(history.longestRun(), skeleton.joints) };
}

describe("resampling", () => {
  it("keeps frames that are even already", () => {
    const { history, motion: even } = motion([1, 1.05, 1.1, 1.15]);
    expect([even.rate, even.frames]).toEqual([20, 4]);
    history.moments.forEach(({ rotation }, frame) => {
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
    history.moments.slice(0, 2).forEach(({ rootPosition, rotation }, frame) => {
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

describe("glTF", () => {
  it("holds an armature, a skin and its motion; VRMA the humanoid's bones", async () => {
    const { motion: even } = motion([0, 0.05, 0.1]);
    const [glb, vrma] = await Promise.all([glbBytes(skeleton, even), vrmaBytes(skeleton, even)]);
    const [body, animation] = [documentOf(glb), documentOf(vrma)];
    expect(body["skins"]).toHaveLength(1);
    expect((body["skins"] as { joints: number[] }[])[0].joints).toHaveLength(skeleton.points.length);
    expect(body["animations"]).toHaveLength(1);
    const extension = (
      animation["extensions"] as Record<string, { humanoid: { humanBones: Record<string, { node: number }> } }>
    )["VRMC_vrm_animation"];
    expect(Object.keys(extension.humanoid.humanBones)).toHaveLength(52);
    expect(extension.humanoid.humanBones["hips"]).toEqual({ node: 0 });
    for (const bytes of [glb, vrma]) {
      const { issues } = await validateBytes(new Uint8Array(bytes));
      expect(issues.numErrors, JSON.stringify(issues.messages.slice(0, 3))).toBe(0);
      expect(JSON.stringify(issues.messages)).not.toContain("NODE_SKINNED_MESH_NON_ROOT");
    }
  });
});

function documentOf(bytes: ArrayBuffer): Record<string, unknown> {
  const length = new DataView(bytes).getUint32(12, true);
  return JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 20, length))) as Record<string, unknown>;
}
