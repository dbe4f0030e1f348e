/** Ghosts of tracking devices: a headset, controllers, pucks on other joints. */

import { CapsuleGeometry, CylinderGeometry, Group, Mesh, MeshStandardMaterial, TorusGeometry } from "three";
import { RoundedBoxGeometry } from "three/addons/geometries/RoundedBoxGeometry.js";
import { UPRIGHT, type Vector } from "../body/math";
import type { Point } from "../body/observation";

const MOST = 6; // points: more of them are a hand's or a picture's, not devices

export class GhostView {
  readonly group = new Group();
  private readonly ghosts = new Map<string, Group>();
  private readonly dark = new MeshStandardMaterial({
    color: "#14393a",
    roughness: 0.35,
    transparent: true,
    opacity: 0.8,
  });
  private readonly clear = new MeshStandardMaterial({ color: "#35d0ba", transparent: true, opacity: 0.55 });

  show(points: readonly Point[]): void {
    for (const ghost of this.ghosts.values()) ghost.visible = false;
    for (const { name, position, rotation } of points.length <= MOST ? points : []) {
      if (!position) continue;
      const ghost = this.ghosts.get(name) ?? this.newGhost(name);
      const [w, x, y, z] = rotation ?? UPRIGHT;
      ghost.visible = true;
      ghost.position.set(...position);
      ghost.quaternion.set(x, y, z, w);
    }
  }

  /** In the axes of the joint: in the T-pose +Y is up, +Z ahead, the left hand points along +X. */
  private newGhost(name: string): Group {
    const ghost = new Group();
    if (name === "head") ghost.add(...this.headset());
    else if (name.endsWith("_wrist")) ghost.add(...this.controller(name.startsWith("left") ? 1 : -1));
    else ghost.add(this.part(new CylinderGeometry(0.045, 0.05, 0.03, 24), this.clear, [0, 0, 0]));
    this.ghosts.set(name, ghost);
    this.group.add(ghost);
    return ghost;
  }

  private headset(): Mesh[] {
    const visor = this.part(new RoundedBoxGeometry(0.19, 0.1, 0.075, 4, 0.03), this.dark, [0, 0.075, 0.125]);
    const strap = this.part(new TorusGeometry(0.095, 0.011, 10, 40), this.clear, [0, 0.08, 0.02]);
    strap.rotation.x = Math.PI / 2;
    strap.scale.y = 1.15;
    return [visor, strap];
  }

  private controller(side: 1 | -1): Mesh[] {
    const handle = this.part(new CapsuleGeometry(0.018, 0.08, 6, 16), this.dark, [side * 0.075, -0.025, 0]);
    const ring = this.part(new TorusGeometry(0.048, 0.008, 10, 32), this.clear, [side * 0.085, -0.01, 0.07]);
    handle.rotation.x = Math.PI / 2; // along the grip
    ring.rotation.y = Math.PI / 8;
    return [handle, ring];
  }

  private part(shape: Mesh["geometry"], material: MeshStandardMaterial, at: Vector): Mesh {
    const mesh = new Mesh(shape, material);
    mesh.position.set(...at);
    mesh.renderOrder = 1;
    return mesh;
  }
}
