/** The signal: a small octahedron at each tracked point, with axes if its rotation is tracked. */

import { AxesHelper, Group, Mesh, MeshBasicMaterial, OctahedronGeometry } from "three";
import { SIGNAL_COLOUR } from "./colours";
import type { Point } from "../body/observation";

export class SignalView {
  readonly group = new Group();
  private readonly marks: Mesh[] = [];
  private readonly shape = new OctahedronGeometry(0.018);
  private readonly small = new OctahedronGeometry(0.006);
  private readonly material = new MeshBasicMaterial({ color: SIGNAL_COLOUR, depthTest: false, transparent: true });

  show(points: readonly Point[]): void {
    while (this.marks.length < points.length) this.marks.push(this.newMark());
    const isCrowd = points.length > 12; // hands: many points close together
    this.marks.forEach((mark, place) => {
      const point = points[place];
      mark.visible = Boolean(point?.position);
      if (!point?.position) return;
      mark.geometry = isCrowd ? this.small : this.shape;
      mark.position.set(...point.position);
      const axes = mark.children[0];
      axes.visible = point.rotation !== null && !isCrowd;
      if (point.rotation) {
        const [w, x, y, z] = point.rotation;
        mark.quaternion.set(x, y, z, w);
      }
    });
  }

  private newMark(): Mesh {
    const mark = new Mesh(this.shape, this.material);
    mark.renderOrder = 2;
    mark.add(new AxesHelper(0.09));
    this.group.add(mark);
    return mark;
  }
}
