// Completes a body and poses the bones of a glTF avatar that is loaded in its T-pose, facing +Z.
import { openModel } from "@bodysense/core";
import { Quaternion, Vector3 } from "three";

// The parent of each joint; parents come before their children.
const PARENTS = [
  -1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 22, 23, 20, 25, 26, 20, 28, 29, 20, 31,
  32, 20, 34, 35, 21, 37, 38, 21, 40, 41, 21, 43, 44, 21, 46, 47, 21, 49, 50,
];

/**
 * Return a function that poses the avatar: of a time in seconds, and of the objects that are where joints are tracked.
 *
 * `weights` is the content of completion.safetensors, `names` the avatar's bone of each joint, {pelvis: "Hips", …}.
 */
export async function avatar(weights, scene, names, person = {}) {
  const model = await openModel(new Uint8Array(weights));
  const state = model.start(person);
  const bones = PARENTS.map((_, joint) => {
    const name = names[model.points[joint]];
    const bone = name ? scene.getObjectByName(name) : null;
    if (name && !bone) throw new Error(`no bone is called ${name}`);
    return bone;
  });
  const rest = bones.map((bone) => bone?.getWorldQuaternion(new Quaternion()));
  const world = PARENTS.map(() => new Quaternion());
  return (seconds, tracked) => {
    const points = Object.entries(tracked).map(([name, object]) => {
      const { x, y, z, w } = object.getWorldQuaternion(new Quaternion());
      const position = object.getWorldPosition(new Vector3()).toArray();
      return { name, position, rotation: [w, x, y, z], accuracy: 0.001 };
    });
    const body = state.step({ time: seconds, points });
    bones.forEach((bone, joint) => {
      const [w, x, y, z] = body.rotation.subarray(4 * joint);
      world[joint].set(x, y, z, w);
      if (joint > 0) world[joint].premultiply(world[PARENTS[joint]]);
      if (!bone) return;
      const outside = bone.parent.getWorldQuaternion(new Quaternion());
      bone.quaternion.copy(outside.invert().multiply(world[joint]).multiply(rest[joint]));
      if (joint === 0) bone.position.copy(bone.parent.worldToLocal(new Vector3(...body.rootPosition)));
    });
    return body;
  };
}
