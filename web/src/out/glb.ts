/** glTF: an animated tree of joints with a capsule on every bone, written by three.js. */

import {
  AnimationClip,
  CapsuleGeometry,
  Group,
  Mesh,
  MeshStandardMaterial,
  Object3D,
  Quaternion,
  QuaternionKeyframeTrack,
  Vector3,
  VectorKeyframeTrack,
  type KeyframeTrack,
} from "three";
import { GLTFExporter } from "three/addons/exporters/GLTFExporter.js";
import type { Motion } from "./resample";
import type { Skeleton } from "../core/skeleton";

const UP = new Vector3(0, 1, 0);

export async function glbBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  const body = new Group();
  body.name = "body";
  body.add(tree(skeleton));
  const result = await new GLTFExporter().parseAsync(body, { binary: true, animations: [animation(skeleton, motion)] });
  if (!(result instanceof ArrayBuffer)) throw new Error("the glTF exporter returned no bytes; report this");
  return result;
}

function tree(skeleton: Skeleton): Object3D {
  const material = new MeshStandardMaterial({ color: "#9db4c8", roughness: 0.7, metalness: 0 });
  const nodes = skeleton.points.map((name, point) => {
    const node = new Object3D();
    node.name = name;
    if (point > 0) node.position.fromArray(skeleton.restOffset, 3 * point);
    return node;
  });
  skeleton.parents.forEach((parent, point) => {
    if (parent < 0) return;
    nodes[parent].add(nodes[point]);
    const bone = capsule(nodes[point].position, material);
    if (bone) nodes[parent].add(bone);
  });
  return nodes[0];
}

function capsule(offset: Vector3, material: MeshStandardMaterial): Mesh | null {
  const length = offset.length();
  if (length < 0.005) return null;
  const radius = Math.min(0.16 * length, 0.05);
  const mesh = new Mesh(new CapsuleGeometry(radius, length, 4, 10), material);
  mesh.position.copy(offset).multiplyScalar(0.5);
  mesh.quaternion.copy(new Quaternion().setFromUnitVectors(UP, offset.clone().normalize()));
  return mesh;
}

function animation(skeleton: Skeleton, motion: Motion): AnimationClip {
  const times = Float32Array.from({ length: motion.frames }, (_, frame) => frame / motion.rate);
  const tracks: KeyframeTrack[] = [new VectorKeyframeTrack(`${skeleton.points[0]}.position`, times, motion.root)];
  for (let joint = 0; joint < skeleton.joints; joint++) {
    const values = new Float32Array(4 * motion.frames);
    for (let frame = 0; frame < motion.frames; frame++) {
      const [w, x, y, z] = motion.rotation.subarray(4 * (skeleton.joints * frame + joint));
      values.set([x, y, z, w], 4 * frame);
    }
    tracks.push(new QuaternionKeyframeTrack(`${skeleton.points[joint]}.quaternion`, times, values));
  }
  return new AnimationClip("motion", -1, tracks);
}

export async function vrmaBytes(skeleton: Skeleton, motion: Motion): Promise<ArrayBuffer> {
  return glbBytes(skeleton, motion);
}
