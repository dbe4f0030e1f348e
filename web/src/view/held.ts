/** A wearer's hands in VR: joints of tracked hands, controllers, and the rays that point at the menu. */

import {
  BufferGeometry,
  CapsuleGeometry,
  Group,
  InstancedMesh,
  Line,
  LineBasicMaterial,
  Matrix4,
  Mesh,
  MeshStandardMaterial,
  SphereGeometry,
  TorusGeometry,
  Vector3,
  type Object3D,
} from "three";

const MOST = 2; // hands
const JOINTS = 25; // of a hand in WebXR
const RAY = 2; // m, length of a drawn ray that hits nothing
const THIN = 0.006; // m, radius of a joint whose size is unknown

/** One drawn hand: its joints or its controller, and its ray. */
class Hand {
  readonly group = new Group();
  private readonly joints: InstancedMesh;
  private readonly controller = new Group();
  private readonly ray: Line<BufferGeometry, LineBasicMaterial>;

  constructor() {
    const skin = new MeshStandardMaterial({ color: "#d9b8a0", roughness: 0.7 });
    const dark = new MeshStandardMaterial({ color: "#14393a", roughness: 0.35 });
    this.joints = new InstancedMesh(new SphereGeometry(1, 12, 8), skin, JOINTS);
    const handle = new Mesh(new CapsuleGeometry(0.018, 0.08, 6, 16).rotateX(Math.PI / 2), dark);
    const ring = new Mesh(new TorusGeometry(0.045, 0.007, 10, 32), dark);
    ring.position.z = -0.06;
    this.controller.add(handle, ring);
    const line = new BufferGeometry().setFromPoints([new Vector3(), new Vector3(0, 0, -RAY)]);
    this.ray = new Line(line, new LineBasicMaterial({ color: "#0f6a63", transparent: true, opacity: 0.6 }));
    this.joints.frustumCulled = this.ray.frustumCulled = false;
    for (const part of [this.controller, this.ray]) part.matrixAutoUpdate = false;
    this.group.add(this.joints, this.controller, this.ray);
  }

  show(frame: XRFrame, space: XRSpace, source: XRInputSource): void {
    const joints = [...(source.hand?.values() ?? [])].flatMap((joint) => frame.getJointPose?.(joint, space) ?? []);
    this.joints.visible = joints.length > 0;
    this.joints.count = Math.min(joints.length, JOINTS);
    const place = new Matrix4();
    joints.slice(0, JOINTS).forEach(({ transform, radius }, k) => {
      const size = radius || THIN;
      this.joints.setMatrixAt(k, place.fromArray(transform.matrix).scale(new Vector3(size, size, size)));
    });
    this.joints.instanceMatrix.needsUpdate = true;
    const grip = joints.length === 0 && source.gripSpace ? frame.getPose(source.gripSpace, space) : undefined;
    put(this.controller, grip);
    put(this.ray, frame.getPose(source.targetRaySpace, space));
  }

  /** Let the ray end at `metres`. */
  reach(metres: number | null): void {
    this.ray.geometry.setFromPoints([new Vector3(), new Vector3(0, 0, -(metres ?? RAY))]);
  }
}

export class Held {
  readonly group = new Group();
  private readonly hands = Array.from({ length: MOST }, () => new Hand());

  constructor() {
    this.group.add(...this.hands.map(({ group }) => group));
    this.group.visible = false;
  }

  /** Draw the inputs of one frame; `reaches` are the distances at which their rays hit something, m. */
  show(frame: XRFrame, space: XRSpace, sources: readonly XRInputSource[], reaches: readonly (number | null)[]): void {
    this.hands.forEach((hand, k) => {
      const source = sources[k];
      hand.group.visible = source !== undefined;
      if (!source) return;
      hand.show(frame, space, source);
      hand.reach(reaches[k] ?? null);
    });
  }
}

function put(part: Object3D, pose: XRPose | undefined): void {
  part.visible = pose !== undefined;
  if (pose) part.matrix.fromArray(pose.transform.matrix);
  part.matrixWorldNeedsUpdate = true;
}
