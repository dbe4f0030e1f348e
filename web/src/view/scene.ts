/** The 3-D view: renderer, camera, light and a floor that fades. */

import {
  CanvasTexture,
  CircleGeometry,
  Color,
  DirectionalLight,
  Fog,
  Group,
  HemisphereLight,
  LinearFilter,
  Mesh,
  MeshBasicMaterial,
  PerspectiveCamera,
  Scene,
  ShadowMaterial,
  SRGBColorSpace,
  VSMShadowMap,
  WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { CONTACT_SHADOWS } from "./contact_shadow";
import { Thrift } from "./thrift";

export type Look = "light" | "dark";

const LOOK_AT = [0, 0.8, 0] as const; // m
const FROM = [0.9, 1.3, 3.4] as const; // m
const PAPER = { light: "#eceae4", dark: "#15171c" } as const;
const FLOOR = { light: ["#ffffff", "#cfcabd"], dark: ["#2a2e37", "#3b414d"] } as const; // middle and lines
const RADIUS = 4.5; // m, of the floor
const [SHADE, SHADE_AT] = [1.65, [-0.38, 0, -0.56]] as const; // m: within the floor area that the light covers
const CLEAR = 200; // pixels between the middle of the body and the panel next to it
const FINEST = 4; // anisotropy of textures
const AFTER = 4; // 1/s: rate at which the camera follows the body

/** The part of a distance, m, that the camera moves by within `seconds`; the same however many pictures are drawn. */
export function followed(distance: number, seconds: number): number {
  return distance * (1 - Math.exp(-AFTER * Math.max(seconds, 0)));
}

export class View {
  readonly scene = new Scene();
  readonly stage = new Group(); // everything that is tracked or completed; the mirror turns it over
  readonly camera = new PerspectiveCamera(38, 1, 0.02, 60);
  readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly floor = new Group();
  private readonly shade: Mesh;
  private readonly sun = sun();
  private readonly thrift: Thrift;
  private readonly paint_ = new MeshBasicMaterial({
    transparent: true,
    depthWrite: false,
    toneMapped: false,
    fog: false,
  });
  private readonly isFast: boolean; // a graphics card draws
  private isPortrait = false;
  private isRoom = false;
  private look: Look = "light";

  /** `over` is over the bottom of the canvas where it is fixed, `beside` over its left, and one of `panels` over its right
   * while it is open: the body is clear of all.
   *
   * `isClear`: see `clear`.
   */
  constructor(
    canvas: HTMLCanvasElement,
    private readonly over: HTMLElement,
    private readonly beside: HTMLElement,
    private readonly panels: readonly HTMLElement[],
    public isClear = false,
  ) {
    const isFast = (this.isFast = hasGraphicsCard());
    this.renderer = new WebGLRenderer({
      canvas,
      antialias: isFast,
      powerPreference: "high-performance",
    });
    this.renderer.debug.checkShaderErrors = import.meta.env.DEV; // each check waits for the graphics card
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.shadowMap.type = VSMShadowMap;
    this.renderer.xr.enabled = true;
    document.documentElement.dataset["drawing"] = isFast ? "rich" : "plain";
    this.thrift = new Thrift(this.renderer, isFast);
    const disc = new Mesh(new CircleGeometry(RADIUS, 64), this.paint_);
    this.shade = new Mesh(new CircleGeometry(SHADE, 48), new ShadowMaterial({ opacity: 0.28, depthWrite: false }));
    disc.rotation.x = this.shade.rotation.x = -Math.PI / 2;
    disc.renderOrder = -2; // both lie on y = 0 and are drawn one after the other: nothing flickers
    this.shade.position.set(...SHADE_AT);
    this.shade.renderOrder = -1;
    this.shade.receiveShadow = true;
    this.floor.add(disc, this.shade);
    const rim = new DirectionalLight("#ffe8d0", 1.1);
    rim.position.set(-2.5, 2.6, -3);
    this.scene.add(
      this.stage,
      this.floor,
      new HemisphereLight("#ffffff", "#a59c8c", 1.55),
      this.sun,
      this.sun.target,
      rim,
    );
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.52 * Math.PI;
    this.controls.minDistance = 0.5;
    this.controls.maxDistance = 9;
    this.controls.enableDamping = true;
    this.controls.listenToKeyEvents(canvas);
    this.controls.keyPanSpeed = 20;
    this.reset();
    const sizes = new ResizeObserver(() => this.resize());
    sizes.observe(canvas.parentElement ?? canvas);
    for (const one of [over, ...panels]) sizes.observe(one);
  }

  /** The camera back to its place: before the body, a little to its left. */
  reset(): void {
    const away = this.isPortrait ? 1.12 : 1;
    this.controls.target.set(...LOOK_AT);
    this.camera.position.set(FROM[0] * away, FROM[1], FROM[2] * away);
    this.camera.up.set(0, 1, 0);
    this.controls.update();
  }

  /** Follow a body at (x, z), m, `seconds` after the previous picture. */
  follow(x: number, z: number, seconds: number): void {
    const { target } = this.controls;
    const [dx, dz] = [x - target.x, z - target.z].map((distance) => followed(distance, seconds));
    target.x += dx;
    target.z += dz;
    this.camera.position.x += dx;
    this.camera.position.z += dz;
    this.lightAt(target.x, target.z);
  }

  /** Move light and floor to a body at (x, z), m. */
  lightAt(x: number, z: number): void {
    this.sun.position.set(x + 1.6, 4.2, z + 2.4);
    this.sun.target.position.set(x, 0.8, z);
    this.floor.position.setX(x).setZ(z);
  }

  /** Move the floor up or down to a height, m. */
  floorAt(height: number): void {
    this.floor.position.y = height;
  }

  /** Draw nothing but the body and its shadow, as recording programs overlay it, or all again. */
  clear(isClear: boolean): void {
    this.isClear = isClear;
    this.paint(this.look);
  }

  /** Leave wheel and vertical swipes to the embedding page, which scrolls by them. */
  letScroll(): void {
    this.controls.enableZoom = false;
    this.renderer.domElement.style.touchAction = "pan-y";
  }

  /** Whether the wearer's own room is behind the body, in place of the page's floor. */
  showRoom(isRoom: boolean): void {
    this.isRoom = isRoom;
    this.paint(this.look);
  }

  paint(look: Look): void {
    this.look = look;
    const isBare = this.isClear || this.isRoom;
    this.renderer.setClearAlpha(isBare ? 0 : 1);
    this.scene.background = isBare ? null : new Color(PAPER[look]);
    this.scene.fog = isBare ? null : new Fog(PAPER[look], 7, 14);
    this.paint_.visible = !isBare;
    this.paint_.map?.dispose();
    this.paint_.map = floorTexture(FLOOR[look][0], FLOOR[look][1], this.isFast);
    if (this.isFast) this.paint_.map.anisotropy = FINEST;
    this.paint_.needsUpdate = true;
  }

  /** Call `frame` for every picture; in a headset it gets the frame of its session. */
  run(frame: (milliseconds: number, xr: XRFrame | undefined) => void): void {
    this.renderer.setAnimationLoop((milliseconds: number, xr?: XRFrame) => {
      const isDue = this.thrift.isDue(milliseconds);
      if (!xr && !isDue) return;
      frame(milliseconds, xr);
      if (!this.renderer.xr.isPresenting) {
        this.controls.update();
        if (this.thrift.frame(milliseconds)) this.resize();
        this.shade.visible = this.renderer.shadowMap.enabled;
      }
      const isShaded = !this.renderer.xr.isPresenting && !this.renderer.shadowMap.enabled;
      this.camera.layers[isShaded ? "enable" : "disable"](CONTACT_SHADOWS);
      if (isDue) this.renderer.render(this.scene, this.camera);
    });
  }

  private resize(): void {
    const box = this.renderer.domElement.parentElement;
    if (!box || this.renderer.xr.isPresenting) return;
    const { clientWidth: width, clientHeight: height } = box;
    if (width === 0 || height === 0) return;
    const wasPortrait = this.isPortrait;
    this.isPortrait = width < 0.8 * height;
    const isOver = this.over.clientHeight > 0 && getComputedStyle(this.over).position === "fixed";
    const free = height - (isOver ? Math.min(height - this.over.offsetTop, height / 2) : 0);
    const aside = isOver ? this.shift(width) : 0;
    this.camera.aspect = width / free;
    this.camera.setViewOffset(width, free, -aside, 0, width, height); // the picture continues below the free part
    this.renderer.setSize(width, height, false);
    if (wasPortrait !== this.isPortrait) this.reset();
  }

  /** Pixels by which the body is right of the middle: clear of what is over the left, between that and an open panel. */
  private shift(width: number): number {
    const { right } = this.beside.getBoundingClientRect();
    const clear = Math.min(Math.max(right + CLEAR - width / 2, 0), width / 8);
    const open = this.panels.find(({ hidden }) => !hidden)?.getBoundingClientRect();
    return open ? Math.min(clear, (right + open.left - width) / 2) : clear;
  }
}

/** Whether a graphics card draws; true if the browser does not report it. */
function hasGraphicsCard(): boolean {
  const context = document.createElement("canvas").getContext("webgl2");
  const names = context?.getExtension("WEBGL_debug_renderer_info");
  const name = String(context?.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? context.RENDERER));
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return !/swiftshader|llvmpipe|softpipe|software|basic render/i.test(name);
}

function sun(): DirectionalLight {
  const light = new DirectionalLight("#fff6ea", 2.1);
  light.position.set(1.6, 4.2, 2.4);
  light.castShadow = true;
  light.shadow.mapSize.set(512, 512);
  light.shadow.camera.left = light.shadow.camera.bottom = -1.8;
  light.shadow.camera.right = light.shadow.camera.top = 1.8;
  [light.shadow.camera.near, light.shadow.camera.far] = [1.5, 8]; // m: tight, so that feet touch their shadow
  light.shadow.radius = 7;
  light.shadow.blurSamples = 16;
  return light;
}

/** A disc that fades to nothing, with faint rings a metre apart. */
function floorTexture(middle: string, line: string, isFine: boolean): CanvasTexture {
  const size = isFine ? 1024 : 256;
  const canvas = document.createElement("canvas");
  canvas.width = canvas.height = size;
  const context = canvas.getContext("2d");
  if (context) {
    const half = size / 2;
    const fade = context.createRadialGradient(half, half, 0, half, half, half);
    fade.addColorStop(0, middle);
    fade.addColorStop(0.35, `${middle}b0`);
    fade.addColorStop(1, `${middle}00`);
    context.fillStyle = fade;
    context.fillRect(0, 0, size, size);
    context.strokeStyle = line;
    for (let metre = 1; metre < RADIUS; metre++) {
      context.globalAlpha = 0.55 * (1 - metre / RADIUS);
      context.lineWidth = size / 512;
      context.beginPath();
      context.arc(half, half, (metre / RADIUS) * half, 0, 2 * Math.PI);
      context.stroke();
    }
  }
  const texture = new CanvasTexture(canvas);
  texture.colorSpace = SRGBColorSpace;
  if (!isFine) [texture.generateMipmaps, texture.minFilter] = [false, LinearFilter];
  return texture;
}
