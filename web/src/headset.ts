/** Enter VR: the wearer's signal goes out every frame, and they see their completed body in a mirror. */

import { Matrix4 } from "three";
import { Mirror } from "./mirror";
import type { Placed, SignalPoint } from "./protocol";
import type { View } from "./scene";
import { HeadsetReader } from "./xr_signal";

export interface HeadsetEvents {
  entered(): void;
  /** What the headset tracks at `time` (s). */
  tracked(time: number, points: SignalPoint[]): void;
  left(): void;
}

export class Headset {
  private readonly mirror = new Mirror();
  private readonly toSignal = new Matrix4(); // signal's world ← body's world
  private reader = new HeadsetReader();
  private isMirrorPlaced = false;

  constructor(
    private readonly view: View,
    private readonly events: HeadsetEvents,
  ) {
    view.scene.add(this.mirror.frame);
  }

  /** Whether this browser has a headset. */
  static async isThere(): Promise<boolean> {
    return (await navigator.xr?.isSessionSupported("immersive-vr").catch(() => false)) ?? false;
  }

  /** From a click. Throws an Error where the headset refuses. */
  async enter(): Promise<void> {
    const session = await navigator.xr?.requestSession("immersive-vr", {
      requiredFeatures: ["local-floor"],
      optionalFeatures: ["hand-tracking"],
    });
    if (!session) throw new Error("This browser has no headset; open the page in the browser of a headset.");
    session.addEventListener("end", () => this.leave());
    await this.view.renderer.xr.setSession(session);
    this.view.renderer.xr.getReferenceSpace()?.addEventListener("reset", () => (this.isMirrorPlaced = false));
    this.reader = new HeadsetReader();
    this.isMirrorPlaced = false;
    this.mirror.frame.visible = true;
    this.view.stage.matrixAutoUpdate = false;
    this.events.entered();
  }

  /** How the server moves the signal's world into the body's: the mirror stands in the signal's. */
  place({ offset, heading }: Pick<Placed, "offset" | "heading">): void {
    this.toSignal
      .makeRotationY(heading)
      .setPosition(...offset)
      .invert();
    this.isMirrorPlaced = false;
  }

  /** Read one frame of the headset. */
  read(milliseconds: number, frame: XRFrame): void {
    const { xr } = this.view.renderer;
    const [space, session] = [xr.getReferenceSpace(), xr.getSession()];
    if (!space || !session) return;
    const points = this.reader.read(frame, space, session.inputSources);
    const viewer = points.find(({ point }) => point === 0);
    if (!this.isMirrorPlaced && viewer?.position && viewer.rotation) this.placeMirror(viewer.position, viewer.rotation);
    if (points.length > 0) this.events.tracked(milliseconds / 1000, points);
  }

  private placeMirror(...head: Parameters<Mirror["standBefore"]>): void {
    this.mirror.standBefore(...head);
    this.view.stage.matrix.multiplyMatrices(this.mirror.reflection(), this.toSignal);
    this.view.stage.matrixWorldNeedsUpdate = true;
    this.isMirrorPlaced = true;
  }

  private leave(): void {
    this.mirror.frame.visible = false;
    this.view.stage.matrix.identity();
    this.view.stage.matrixAutoUpdate = true;
    this.view.stage.matrixWorldNeedsUpdate = true;
    this.events.left();
  }
}
