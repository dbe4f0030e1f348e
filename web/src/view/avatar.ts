/** A VRM avatar in place of the capsules. */

import { VRMLoaderPlugin, VRMUtils, type VRM, type VRMHumanBoneName } from "@pixiv/three-vrm";
import type { Group } from "three";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { GLTFLoader, type GLTF } from "three/addons/loaders/GLTFLoader.js";
import type { Quaternion } from "../body/math";
import { refuseHugeGlb } from "../files/glb_bounds";
import { drivenJoints, fromRest, localRotation, type Driven } from "./retarget";
import { rootHeight, type Body, type Skeleton } from "../body/skeleton";

const HEAD = 2 ** 20; // bytes: of the JSON at the beginning of a file

/** Read the bytes of a .vrm or .glb file. Throws an Error of one line for other bytes and for no figure. */
export async function readGlb(bytes: ArrayBuffer, name: string): Promise<GLTF> {
  refuseHugeGlb(bytes, name);
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder).register((parser) => new VRMLoaderPlugin(parser));
  if (isPackedByDraco(bytes)) {
    const { DRACOLoader, DRACO_GLTF_CONFIG } = await import("three/addons/loaders/DRACOLoader.js"); // with its decoder
    loader.setDRACOLoader(new DRACOLoader().setDecoderPath(DRACO_GLTF_CONFIG));
  }
  const file = await loader.parseAsync(bytes, "").catch(() => {
    throw new Error(`${name} is damaged: it cannot be read as glTF; export it again.`);
  });
  if (!(file.scene as Group | undefined))
    throw new Error(`${name} is empty: no figure is in it; select the figure and export it again.`);
  return file;
}

function isPackedByDraco(bytes: ArrayBuffer): boolean {
  const head = new Uint8Array(bytes, 0, Math.min(bytes.byteLength, HEAD));
  return new TextDecoder().decode(head).includes("KHR_draco_mesh_compression");
}

export class Avatar {
  private driven: readonly Driven[] = [];
  private skeleton: Skeleton | null = null; // that it is fitted to
  private readonly isOld: boolean; // VRM 0 faces −Z, VRM 1 and the body here +Z
  private readonly hipsHeight: number; // m, in the avatar's rest pose

  /** `corrections`: world rotations of the body's joints in its T-pose's axes while the avatar rests; null: the same. */
  constructor(
    private readonly vrm: VRM,
    private readonly corrections: readonly Quaternion[] | null = null,
  ) {
    const { humanoid } = vrm;
    this.isOld = vrm.meta.metaVersion === "0";
    VRMUtils.rotateVRM0(vrm);
    this.hipsHeight = Math.max(humanoid.normalizedRestPose.hips?.position?.[1] ?? 1, 0.05);
    vrm.scene.traverse((part) => {
      part.frustumCulled = false;
      part.castShadow = true;
    });
  }

  /** Return the avatar in a file; null without one. */
  static of(file: GLTF, name: string): Avatar | null {
    const vrm = file.userData["vrm"] as VRM | undefined;
    if (!vrm && /\.vrm$/i.test(name))
      throw new Error(`${name} is no VRM: it names no humanoid bones; export it as VRM 0 or 1.`);
    if (!vrm) return null;
    VRMUtils.removeUnnecessaryVertices(file.scene);
    return new Avatar(vrm);
  }

  get group(): Group {
    return this.vrm.scene;
  }

  /** Show a body of a skeleton, `seconds` after the one before (for hair and cloth). */
  show(body: Body, skeleton: Skeleton, seconds: number): void {
    this.fit(skeleton);
    const { humanoid } = this.vrm;
    const turned = this.corrections ? fromRest(body, this.corrections) : body;
    const flip = this.isOld ? -1 : 1;
    for (const driven of this.driven) {
      const [w, x, y, z] = localRotation(turned, driven);
      humanoid.getNormalizedBoneNode(driven.bone as VRMHumanBoneName)?.quaternion.set(flip * x, y, flip * z, w);
    }
    const [x, y, z] = body.position;
    const share = this.hipsHeight / rootHeight(skeleton);
    humanoid.getNormalizedBoneNode("hips")?.position.set(flip * x * share, y * share, flip * z * share);
    this.vrm.update(seconds);
  }

  /** Scale the avatar to the body, by the length of the legs. */
  private fit(skeleton: Skeleton): void {
    if (this.skeleton === skeleton) return;
    const { humanoid } = this.vrm;
    this.skeleton = skeleton;
    this.driven = drivenJoints(skeleton, (bone) => humanoid.getNormalizedBoneNode(bone as VRMHumanBoneName) !== null);
    this.vrm.scene.scale.setScalar(rootHeight(skeleton) / this.hipsHeight);
  }

  dispose(): void {
    this.group.removeFromParent();
    VRMUtils.deepDispose(this.group);
  }
}
