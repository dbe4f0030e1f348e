/** A WebXR headset: its tracked points go to the engine, and the wearer sees their body in a mirror. */

import { HeadsetReader, WearerClock } from "@bodysense/core/webxr";
import { Matrix4, Quaternion, Vector3 } from "three";
import { UNMOVED, applyPlacement, placementAt, type Placement } from "./placement";
import type { Quaternion as Turn, Vector } from "../body/math";
import type { Observation } from "../body/observation";
import { restHeight, restPoint } from "../body/skeleton";
import type { Live } from "../live";
import { Held } from "../view/held";
import { Mirror } from "../view/mirror";
import type { View } from "../view/scene";
import type { VrMenu } from "../view/vr_menu";
import type { Source } from "./source";

export interface HeadsetEvents {
  /** One frame was tracked; the engine gets the same. */
  tracked(observation: Observation): void;
  /** The session ended; `wasRequested`: by the page, not by the headset. */
  left(wasRequested: boolean): void;
}

export type Immersion = "immersive-vr" | "immersive-ar";

/** Return what a headset on this page lacks, as a sentence; null if it can be used. */
export async function missingForHeadset(): Promise<string | null> {
  if (!isSecureContext)
    return "A headset needs a safe address: open this page by https, or as http://localhost on the headset itself (`adb reverse tcp:8000 tcp:8000`).";
  if (!navigator.xr)
    return "This browser has no WebXR: open the page in the headset's own browser, or in Chrome with a headset connected.";
  const isThere = await navigator.xr.isSessionSupported("immersive-vr").catch(() => false);
  return isThere
    ? null
    : "No headset answers: switch it on and connect it, or open this page in the headset's own browser.";
}

export class Headset implements Source {
  readonly title = "You, by headset";
  readonly isYou = true;
  readonly guide =
    "Put the headset on: a menu stands beside the mirror. Measure me comes first; a take stays when you leave.";
  readonly sensors = ["head", "left_wrist", "right_wrist"];
  isMirrorVisible = true;
  isSeated = false;
  private readonly mirror = new Mirror();
  private readonly held = new Held();
  private reader = new HeadsetReader();
  private placement: Placement = UNMOVED;
  private hasPlacement = false;
  private readonly clock = new WearerClock();
  private session: XRSession | null = null;
  private wasRequested = false;
  private seatedLift = 0; // m: lift that raises a seated wearer to standing height
  private lift = 0; // m: current lift; it shrinks when the wearer gets up

  constructor(
    private readonly view: View,
    private readonly live: Live,
    private readonly menu: VrMenu,
    private readonly events: HeadsetEvents,
  ) {
    view.scene.add(this.mirror.frame, menu.board, this.held.group);
  }

  get isActive(): boolean {
    return this.session !== null;
  }

  /** Enter VR or the wearer's own room; call it from a click. Throws an Error of one line if the headset refuses. */
  async enter(mode: Immersion): Promise<void> {
    const options = { requiredFeatures: ["local-floor"], optionalFeatures: ["hand-tracking", "body-tracking"] };
    const session = await navigator.xr?.requestSession(mode, options).catch((error: unknown) => {
      throw new Error(
        `The headset did not let this page in (${error instanceof Error ? error.message : "no reason given"}); allow it, and press again.`,
      );
    });
    if (!session) throw new Error("This browser has no WebXR: open the page in the headset's own browser.");
    if (session.interactionMode === "screen-space") {
      await session.end();
      throw new Error("This device is held, not worn: open the page in a headset's browser to see your room.");
    }
    this.view.showRoom(mode === "immersive-ar");
    this.wasRequested = this.hasPlacement = false;
    this.reader = new HeadsetReader();
    session.addEventListener("end", () => this.leave());
    session.addEventListener("select", (event) => this.select(event));
    await this.view.renderer.xr.setSession(session);
    this.session = session;
    this.view.renderer.xr.getReferenceSpace()?.addEventListener("reset", () => this.recentre());
    this.menu.board.visible = this.held.group.visible = true;
    this.showMirror(this.isMirrorVisible); // as the wearer left it
    this.view.stage.matrixAutoUpdate = false;
  }

  /** Place the wearer in the middle, facing the front, from the next frame on. */
  recentre(): void {
    this.hasPlacement = false;
  }

  /** Raise a seated wearer to standing head height from the next frame on; false: do not. */
  sit(isSeated: boolean): void {
    this.isSeated = isSeated;
    this.recentre();
  }

  showMirror(isVisible: boolean): void {
    this.isMirrorVisible = isVisible;
    this.mirror.frame.visible = this.view.stage.visible = isVisible;
  }

  frame(milliseconds: number, frame?: XRFrame): void {
    const space = this.view.renderer.xr.getReferenceSpace();
    if (!frame || !space || !this.session) return;
    const size = restHeight(this.live.tree) / restHeight(this.live.skeleton);
    const points = this.reader.read(frame, space, this.session.inputSources, size);
    const head = points.find(({ name }) => name === "head");
    if (head?.position && head.rotation) {
      if (!this.hasPlacement) this.place(head.position, head.rotation, frame.getViewerPose(space));
      this.raise(Math.min(this.seatedLift, Math.max(this.standingHead() - head.position[1], 0)));
    }
    if (points.length > 0) {
      const time = this.clock.time(milliseconds / 1000, head);
      this.events.tracked({ time, points: applyPlacement(points, this.placement) });
    }
    const sources = [...this.session.inputSources];
    const rays = sources.map(({ targetRaySpace }) => frame.getPose(targetRaySpace, space));
    const reaches = this.menu.point(rays.map((pose) => (pose ? new Matrix4().fromArray(pose.transform.matrix) : null)));
    this.held.show(frame, space, sources, reaches);
  }

  /** End the session at the user's request. */
  stop(): void {
    this.wasRequested = true;
    void this.session?.end().catch(() => undefined); // it may have ended by itself
  }

  private place(position: Vector, rotation: Turn, viewer: XRViewerPose | undefined): void {
    this.lift = this.seatedLift = this.isSeated ? Math.max(this.standingHead() - position[1], 0) : 0;
    this.placement = placementAt(position, rotation, this.lift);
    if (viewer) {
      const { position: p, orientation: q } = viewer.transform;
      this.mirror.standBefore([p.x, p.y, p.z], [q.w, q.x, q.y, q.z]);
      const { x: across, z: along } = new Vector3(p.x, p.y, p.z).applyMatrix4(this.mirror.reflection());
      this.view.lightAt(across, along);
    }
    this.menu.standBeside(this.mirror.frame);
    this.mirrorStage();
    this.hasPlacement = true;
    this.clock.leap();
  }

  /** Raise the wearer by `lift` m. */
  private raise(lift: number): void {
    if (Math.abs(lift - this.lift) < 1e-4) return;
    const [x, , z] = this.placement.offset;
    this.lift = lift;
    this.placement = { ...this.placement, offset: [x, lift, z] };
    this.mirrorStage();
  }

  /** Move the stage behind the mirror, by the wearer's placement. */
  private mirrorStage(): void {
    const [w, x, y, z] = this.placement.turn;
    const toBody = new Matrix4().compose(
      new Vector3(...this.placement.offset),
      new Quaternion(x, y, z, w),
      new Vector3(1, 1, 1),
    );
    this.view.stage.matrix.multiplyMatrices(this.mirror.reflection(), toBody.invert());
    this.view.stage.matrixWorldNeedsUpdate = true;
    // A raised body is mirrored at the wearer's eyes: its feet are below the real floor.
    this.view.floorAt(-this.lift);
    this.mirror.reachDown(-this.lift);
  }

  private select({ frame, inputSource }: XRInputSourceEvent): void {
    const space = this.view.renderer.xr.getReferenceSpace();
    const pose = space && frame.getPose(inputSource.targetRaySpace, space);
    if (pose) this.menu.press(new Matrix4().fromArray(pose.transform.matrix));
  }

  /** Height of the head joint of the displayed body when standing, m. */
  private standingHead(): number {
    return restPoint(this.live.tree, "head")[1];
  }

  private leave(): void {
    this.session = null;
    this.mirror.frame.visible = this.menu.board.visible = this.held.group.visible = false;
    this.view.showRoom(false);
    this.view.stage.visible = true;
    this.view.stage.matrixAutoUpdate = true;
    this.view.floorAt(0);
    this.view.reset();
    this.events.left(this.wasRequested);
  }
}
