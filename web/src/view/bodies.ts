/** The bodies of the scene: the result (an avatar, or a figure that shows how sure it is), the truth, the signal. */

import type { Object3D } from "three";
import { withOffsets, type Skeleton } from "../body/skeleton";
import type { Moment } from "../takes/history";
import { BodyView } from "./body_view";
import { pointColour, TRUTH_COLOUR, type Colouring } from "./colours";
import { ContactShadow } from "./contact_shadow";
import { GhostView } from "./ghost_view";
import { Seat } from "./seat";
import { SignalView } from "./signal_view";
import { Wardrobe } from "./wardrobe";

/** Choices of what the scene displays. */
export interface DisplaySettings {
  readonly figure: "avatar" | "figure";
  readonly colouring: Colouring;
  readonly truth: boolean;
  readonly signal: boolean;
  readonly ghosts: boolean; // of headset and controllers
}

const GROWN = 0.004; // m: proportions that differ by less look the same

export class Bodies {
  private result: BodyView | null = null;
  private truth: BodyView | null = null;
  readonly wardrobe: Wardrobe;
  private skeleton: Skeleton | null = null; // that the figures are built for
  private readonly signal = new SignalView();
  private readonly ghosts = new GhostView();
  private readonly contactShadow = new ContactShadow();
  private readonly seat = new Seat();

  constructor(private readonly stage: Object3D) {
    stage.add(this.signal.group, this.ghosts.group, this.contactShadow.group, this.seat.group);
    this.wardrobe = new Wardrobe(stage);
  }

  /** Show a moment of a body of this tree, `seconds` after the one before. */
  show(moment: Moment, tree: Skeleton, display: DisplaySettings, seconds: number): void {
    this.build(tree, moment.restOffset);
    if (!this.result || !this.truth || !this.skeleton) return;
    const avatar = this.wardrobe.current;
    const isAvatar = display.figure === "avatar" && avatar !== null;
    this.result.group.visible = !isAvatar;
    if (avatar) avatar.group.visible = isAvatar;
    if (isAvatar) avatar.show(moment.body, this.skeleton, seconds);
    else this.result.show(moment.body, (point, out) => pointColour(moment, point, display.colouring, out));
    this.truth.group.visible = display.truth && moment.truth !== null;
    if (this.truth.group.visible && moment.truth) this.truth.show(moment.truth, (_, out) => out.copy(TRUTH_COLOUR));
    this.signal.group.visible = display.signal;
    this.signal.show(moment.signal);
    this.ghosts.group.visible = display.ghosts;
    this.ghosts.show(moment.signal);
    this.contactShadow.group.visible = true;
    this.contactShadow.show(moment.body, tree.points);
    this.seat.show(moment.body, this.skeleton, seconds);
  }

  /** Hide all bodies. */
  clear(): void {
    const { result, truth, signal, ghosts, contactShadow, seat } = this;
    for (const part of [result, truth, this.wardrobe.current, signal, ghosts, contactShadow, seat])
      if (part) part.group.visible = false;
  }

  private build(tree: Skeleton, restOffset: Float32Array): void {
    const now = this.skeleton?.restOffset;
    if (now && restOffset.every((value, k) => Math.abs(value - now[k]) < GROWN)) return;
    this.skeleton = withOffsets(tree, restOffset);
    this.result?.dispose();
    this.truth?.dispose();
    this.result = new BodyView(this.skeleton, 1);
    this.truth = new BodyView(this.skeleton, 0.3);
    this.stage.add(this.result.group, this.truth.group);
  }
}
