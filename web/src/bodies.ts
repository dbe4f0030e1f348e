/** What stands on the stage: the result (capsules or an avatar), the truth and the signal. */

import type { Object3D } from "three";
import type { Avatar } from "./avatar";
import { BodyView } from "./body_view";
import { pointColour, TRUTH_COLOUR } from "./colours";
import type { Moment } from "./history";
import type { Placed } from "./protocol";
import type { Settings } from "./settings";
import { SignalView } from "./signal_view";
import type { Skeleton } from "./skeleton";

export class Bodies {
  private result: BodyView | null = null;
  private truth: BodyView | null = null;
  private avatar: Avatar | null = null;
  private readonly signal = new SignalView();
  private hidden: ReadonlySet<number> = new Set();

  constructor(private readonly stage: Object3D) {
    stage.add(this.signal.group);
  }

  /** Build the bodies of a skeleton. */
  build(skeleton: Skeleton): void {
    this.result?.dispose();
    this.truth?.dispose();
    this.result = new BodyView(skeleton, { opacity: 1 });
    this.truth = new BodyView(skeleton, { opacity: 0.35 });
    this.stage.add(this.result.group, this.truth.group);
    this.result.group.visible = this.truth.group.visible = false;
    this.avatar = this.avatar?.on(skeleton) ?? null;
  }

  /** An avatar in place of the capsules; null: capsules again. */
  wear(avatar: Avatar | null): void {
    this.avatar?.dispose();
    this.avatar = avatar;
    if (avatar) this.stage.add(avatar.group);
  }

  /** Points of the signal that the server does not look at. */
  hide(points: Iterable<number>): void {
    this.hidden = new Set(points);
  }

  placeSignal(placed: Pick<Placed, "offset" | "heading">): void {
    this.signal.place(placed);
  }

  /** Show a moment, `seconds` after the one before. */
  show(moment: Moment, settings: Settings, isWorn: boolean, seconds: number): void {
    if (!this.result || !this.truth) return;
    const { show, colouring } = settings;
    this.result.group.visible = show.result && !this.avatar;
    if (this.result.group.visible) {
      this.result.show(moment.body, (point, out) => pointColour(moment, point, colouring, out));
    }
    if (this.avatar) {
      this.avatar.group.visible = show.result;
      this.avatar.show(moment.body, seconds);
    }
    this.truth.group.visible = show.truth && moment.truth !== null;
    if (this.truth.group.visible && moment.truth) this.truth.show(moment.truth, (_, out) => out.copy(TRUTH_COLOUR));
    this.signal.group.visible = show.signal && !isWorn;
    this.signal.show(moment.signal, this.hidden);
  }
}
