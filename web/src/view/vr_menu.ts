/** A menu in VR, next to the mirror: buttons on a board, pointed at by a hand's or a controller's ray. */

import {
  CanvasTexture,
  Group,
  Mesh,
  MeshBasicMaterial,
  PlaneGeometry,
  Raycaster,
  RingGeometry,
  SRGBColorSpace,
  Vector3,
  type Matrix4,
  type Object3D,
} from "three";

export interface MenuItem {
  readonly text: () => string;
  readonly isOn?: () => boolean;
  readonly press: () => void;
}

/** Where a ray meets the board. */
interface Hit {
  readonly row: number; // −1: above the buttons
  readonly place: Vector3;
  readonly away: number; // m
}

const [WIDTH, ROW, GAP, PIXELS] = [0.5, 0.075, 0.012, 1400]; // m, m, m, pixels a metre
const HEAD = 0.14; // m: the line on top

const HINT = "Point and pinch, or pull the trigger.";

export class VrMenu {
  readonly board = new Group();
  private readonly panel: Mesh<PlaneGeometry, MeshBasicMaterial>;
  private readonly dot: Mesh;
  private readonly hover: Mesh;
  private readonly canvas = document.createElement("canvas");
  private readonly texture: CanvasTexture;
  private readonly caster = new Raycaster();
  private readonly height: number;
  private drawn = "";
  private line = HINT;

  constructor(private readonly items: readonly MenuItem[]) {
    this.height = HEAD + items.length * (ROW + GAP) + GAP;
    this.canvas.width = WIDTH * PIXELS;
    this.canvas.height = this.height * PIXELS;
    this.texture = new CanvasTexture(this.canvas);
    this.texture.colorSpace = SRGBColorSpace;
    const material = new MeshBasicMaterial({ map: this.texture, transparent: true, toneMapped: false });
    this.panel = new Mesh(new PlaneGeometry(WIDTH, this.height), material);
    this.dot = new Mesh(
      new RingGeometry(0.006, 0.01, 24),
      new MeshBasicMaterial({ color: "#0f6a63", depthTest: false }),
    );
    this.hover = new Mesh(
      new PlaneGeometry(WIDTH - 0.05, ROW),
      new MeshBasicMaterial({ color: "#0f6a63", transparent: true, opacity: 0.12, depthTest: false }),
    );
    [this.hover.renderOrder, this.dot.renderOrder] = [4, 5];
    this.hover.visible = this.dot.visible = false;
    this.board.add(this.panel, this.hover, this.dot);
    this.board.visible = false;
  }

  /** Stand to the right of a mirror, turned to the wearer. */
  standBeside(mirror: Object3D): void {
    this.board.position.set(1.12, 1.3, 0.35).applyAxisAngle(UP, mirror.rotation.y).add(mirror.position);
    this.board.rotation.y = mirror.rotation.y - 0.6;
  }

  /** Say one line on top of the buttons; by default how they are pressed. */
  say(line = HINT): void {
    this.line = line;
  }

  /** Rays of hands and controllers, world ← ray; the menu is redrawn if it changed. Returns how far each is from it, m. */
  point(rays: readonly (Matrix4 | null)[]): (number | null)[] {
    const hits = rays.map((ray) => ray && this.hit(ray));
    const hit = hits.find((one) => one !== null);
    this.dot.visible = hit !== undefined;
    this.hover.visible = hit !== undefined && hit.row >= 0; // drawn over the menu's picture, which stays
    if (hit) {
      this.dot.position.copy(this.board.worldToLocal(hit.place)).setZ(0.004);
      this.hover.position.set(0, this.height / 2 - HEAD - hit.row * (ROW + GAP) - ROW / 2, 0.002);
    }
    const state = JSON.stringify([this.line, this.items.map(({ text, isOn }) => [text(), isOn?.()])]);
    if (state !== this.drawn) {
      this.drawn = state;
      this.draw();
    }
    return hits.map((one) => one?.away ?? null);
  }

  /** Press the row that a ray points at. Returns false if it points at none. */
  press(ray: Matrix4): boolean {
    const item = this.items[this.hit(ray)?.row ?? -1];
    item?.press();
    return item !== undefined;
  }

  private hit(ray: Matrix4): Hit | null {
    this.board.updateWorldMatrix(true, true);
    this.caster.ray.origin.setFromMatrixPosition(ray);
    this.caster.ray.direction.set(0, 0, -1).transformDirection(ray);
    const [found] = this.caster.intersectObject(this.panel);
    if (!found?.uv) return null;
    const down = (1 - found.uv.y) * this.height - HEAD;
    return {
      row: down < 0 ? -1 : Math.min(Math.floor(down / (ROW + GAP)), this.items.length - 1),
      place: found.point,
      away: found.distance,
    };
  }

  private draw(): void {
    const context = this.canvas.getContext("2d");
    if (!context) return;
    const m = PIXELS;
    context.clearRect(0, 0, this.canvas.width, this.canvas.height);
    context.fillStyle = "#fbfaf7f2";
    context.beginPath();
    context.roundRect(0, 0, this.canvas.width, this.canvas.height, 0.03 * m);
    context.fill();
    context.textBaseline = "middle";
    context.fillStyle = "#1c1e22";
    context.font = `600 ${0.03 * m}px system-ui, sans-serif`;
    context.fillText("bodysense", 0.03 * m, 0.042 * m);
    context.font = `${0.022 * m}px system-ui, sans-serif`;
    wrapped(context, this.line, (WIDTH - 0.06) * m)
      .slice(0, 2)
      .forEach((text, k) => context.fillText(text, 0.03 * m, (0.082 + 0.028 * k) * m));
    this.items.forEach(({ text, isOn }, row) => {
      const top = (HEAD + row * (ROW + GAP)) * m;
      context.fillStyle = isOn?.() ? "#0f6a63" : "#ece9e1";
      context.beginPath();
      context.roundRect(0.025 * m, top, (WIDTH - 0.05) * m, ROW * m, 0.02 * m);
      context.fill();
      context.fillStyle = isOn?.() ? "#ffffff" : "#1c1e22";
      context.font = `${0.029 * m}px system-ui, sans-serif`;
      context.fillText(text(), 0.05 * m, top + (ROW / 2) * m, (WIDTH - 0.1) * m); // long texts are narrowed
    });
    this.texture.needsUpdate = true;
  }
}

const UP = new Vector3(0, 1, 0);

function wrapped(context: CanvasRenderingContext2D, text: string, width: number): string[] {
  const lines: string[] = [];
  for (const word of text.split(" ")) {
    const longer = lines.length ? `${lines[lines.length - 1]} ${word}` : word;
    if (lines.length && context.measureText(longer).width <= width) lines[lines.length - 1] = longer;
    else lines.push(word);
  }
  return lines;
}
