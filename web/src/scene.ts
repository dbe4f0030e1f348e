/** The 3-D view: renderer, camera, light and floor. */

import {
  Color,
  DirectionalLight,
  Group,
  GridHelper,
  HemisphereLight,
  Mesh,
  PerspectiveCamera,
  PlaneGeometry,
  Scene,
  ShadowMaterial,
  WebGLRenderer,
  type Material,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { Thrift } from "./thrift";

const LOOK_AT = [0, 0.95, 0] as const;
const PAPER = { light: "#eef1f4", dark: "#14171b" } as const;
const LINES = { light: "#b9c2cc", dark: "#39414b" } as const;

export class View {
  readonly scene = new Scene();
  readonly stage = new Group(); // everything that is tracked or completed; the mirror turns it over
  readonly camera = new PerspectiveCamera(45, 1, 0.02, 60);
  readonly renderer: WebGLRenderer;
  private readonly controls: OrbitControls;
  private readonly grid: GridHelper;
  private readonly thrift: Thrift;

  constructor(canvas: HTMLCanvasElement) {
    this.renderer = new WebGLRenderer({ canvas, antialias: true, powerPreference: "high-performance" });
    this.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.renderer.shadowMap.enabled = true;
    this.renderer.xr.enabled = true;
    this.thrift = new Thrift(this.renderer);
    this.grid = new GridHelper(8, 16);
    const floor = new Mesh(new PlaneGeometry(8, 8), new ShadowMaterial({ opacity: 0.18 }));
    floor.rotation.x = -Math.PI / 2;
    floor.receiveShadow = true;
    this.scene.add(this.stage, this.grid, floor, new HemisphereLight("#ffffff", "#8b8f96", 1.9), sun());
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 0.55 * Math.PI;
    this.controls.minDistance = 0.3;
    this.controls.maxDistance = 12;
    this.controls.listenToKeyEvents(canvas);
    this.controls.keyPanSpeed = 20;
    this.reset();
    new ResizeObserver(() => this.resize()).observe(canvas.parentElement ?? canvas);
  }

  /** The camera back to its place: before the body, a little to its left. */
  reset(): void {
    this.controls.target.set(...LOOK_AT);
    this.camera.position.set(1.1, 1.35, 3.1);
    this.controls.update();
  }

  paint(theme: "light" | "dark"): void {
    this.scene.background = new Color(PAPER[theme]);
    this.grid.material.dispose();
    const fresh = new GridHelper(8, 16, LINES[theme], LINES[theme]);
    this.grid.geometry.dispose();
    this.grid.geometry = fresh.geometry;
    (this.grid as { material: Material }).material = fresh.material;
  }

  /** Call `frame` for every picture; in a headset it gets the frame of its session. */
  run(frame: (milliseconds: number, xr: XRFrame | undefined) => void): void {
    this.renderer.setAnimationLoop((milliseconds: number, xr?: XRFrame) => {
      frame(milliseconds, xr);
      if (!this.renderer.xr.isPresenting) {
        this.controls.update();
        if (this.thrift.frame(milliseconds)) this.resize();
      }
      this.renderer.render(this.scene, this.camera);
    });
  }

  private resize(): void {
    const box = this.renderer.domElement.parentElement;
    if (!box || this.renderer.xr.isPresenting) return;
    const { clientWidth: width, clientHeight: height } = box;
    if (width === 0 || height === 0) return;
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.setSize(width, height, false);
  }
}

function sun(): DirectionalLight {
  const light = new DirectionalLight("#ffffff", 1.8);
  light.position.set(1.5, 4, 2.5);
  light.castShadow = true;
  light.shadow.mapSize.set(1024, 1024);
  light.shadow.camera.left = light.shadow.camera.bottom = -2;
  light.shadow.camera.right = light.shadow.camera.top = 2;
  return light;
}
