/** A mirror in front of the wearer: the body is drawn behind its plane, reflected. */

import {
  BoxGeometry,
  Group,
  Matrix4,
  Mesh,
  MeshBasicMaterial,
  MeshStandardMaterial,
  PlaneGeometry,
  Quaternion,
  Vector3,
} from "three";

const AWAY = 1.5; // m from the wearer's head
const [WIDTH, HEIGHT, RIM] = [1.5, 2.1, 0.035]; // m

export class Mirror {
  readonly frame = new Group();
  private readonly built = new Group();

  constructor() {
    const material = new MeshStandardMaterial({ color: "#d9d4c7", roughness: 0.5 });
    const bar = (width: number, height: number, x: number, y: number): Mesh => {
      const mesh = new Mesh(new BoxGeometry(width, height, RIM), material);
      mesh.position.set(x, y, 0);
      return mesh;
    };
    this.built.add(
      bar(WIDTH + 2 * RIM, RIM, 0, HEIGHT),
      bar(RIM, HEIGHT, -(WIDTH + RIM) / 2, HEIGHT / 2),
      bar(RIM, HEIGHT, (WIDTH + RIM) / 2, HEIGHT / 2),
    );
    const glass = new MeshBasicMaterial({ color: "#cfe3e4", transparent: true, opacity: 0.14, depthWrite: false });
    const pane = new Mesh(new PlaneGeometry(WIDTH, HEIGHT), glass);
    pane.position.y = HEIGHT / 2;
    pane.renderOrder = 3; // drawn in front of the reflected scene
    this.built.add(pane);
    this.frame.add(this.built);
    this.frame.visible = false;
  }

  /** Stand upright before a head at `position` that looks along −Z of `rotation` (wxyz). */
  standBefore(position: readonly [number, number, number], rotation: readonly [number, number, number, number]): void {
    const [w, x, y, z] = rotation;
    const look = new Vector3(0, 0, -1).applyQuaternion(new Quaternion(x, y, z, w)).setY(0);
    if (look.length() < 0.1) look.set(0, 0, -1); // straight up or down
    this.frame.position.set(position[0], 0, position[2]).addScaledVector(look.normalize(), AWAY);
    this.frame.rotation.y = Math.atan2(-look.x, -look.z);
  }

  /** Reach down to a floor at a height of at most 0 m. */
  reachDown(floor: number): void {
    this.built.position.y = floor;
    this.built.scale.y = (HEIGHT - floor) / HEIGHT;
  }

  /** The map of the world through this mirror. */
  reflection(): Matrix4 {
    this.frame.updateMatrix();
    const { matrix } = this.frame; // its +Z is the mirror's normal
    return matrix
      .clone()
      .scale(new Vector3(1, 1, -1))
      .multiply(matrix.clone().invert());
  }
}
