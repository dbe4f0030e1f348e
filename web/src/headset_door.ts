/** The headset's door: what is missing for it, its menu in VR, and what happens when it is taken off. */

import type { Observation } from "./body/observation";
import type { DefaultBody } from "./engine/files";
import type { Live } from "./live";
import { Headset, missingForHeadset, type Immersion } from "./sources/headset";
import type { Source } from "./sources/source";
import type { View } from "./view/scene";
import { VrMenu } from "./view/vr_menu";

export interface DoorEvents {
  begin(source: Source): void;
  tracked(frame: Observation): void;
  measure(): void;
  taller(metres: number): void;
  height(): number | null;
  record(): void;
  isRecording(): boolean;
  lookName(): string;
  nextLook(): void;
  seated(isSeated: boolean): void;
  left(text: string, isFault: boolean): void;
}

export class HeadsetDoor {
  isWorn = false;
  isSeated = false;
  private readonly headset: Headset;
  private readonly menu: VrMenu;

  constructor(
    view: View,
    live: Live,
    body: DefaultBody,
    private readonly events: DoorEvents,
  ) {
    this.menu = new VrMenu([
      { id: "measure", text: () => "Measure me", press: () => events.measure() },
      { id: "taller", text: () => `Taller · ${this.heightText()}`, press: () => events.taller(0.01) },
      { id: "shorter", text: () => "Shorter", press: () => events.taller(-0.01) },
      { id: "recentre", text: () => "Recentre", press: () => this.recentre() },
      { id: "seated", text: () => "I am sitting", isOn: () => this.isSeated, press: () => this.sit(!this.isSeated) },
      {
        id: "mirror",
        text: () => "Mirror",
        isOn: () => this.headset.isMirrorShown,
        press: () => this.headset.showMirror(!this.headset.isMirrorShown),
      },
      { id: "look", text: () => `Look · ${events.lookName()}`, press: () => events.nextLook() },
      {
        id: "record",
        text: () => (events.isRecording() ? "Stop recording" : "Record a take"),
        isOn: () => events.isRecording(),
        press: () => events.record(),
      },
      { id: "leave", text: () => "Leave VR", press: () => this.headset.stop() },
    ]);
    this.menu.say("Point and pinch, or pull the trigger.");
    this.headset = new Headset(view, live, body.skeleton, this.menu, {
      tracked: (observation) => {
        events.tracked(observation);
        live.track(observation, null);
      },
      left: (wasAsked) => this.leave(wasAsked),
    });
  }

  /** From a click. Throws an Error of one line that says what is missing. */
  async enter(mode: Immersion): Promise<void> {
    if (this.isWorn) return;
    const missing = await missingForHeadset();
    if (missing) throw new Error(missing);
    await this.headset.enter(mode);
    this.isWorn = true;
    this.events.begin(this.headset);
  }

  /** One line on the menu in VR. */
  say(text: string): void {
    this.menu.say(text);
  }

  recentre(): void {
    this.headset.recentre();
  }

  sit(isSeated: boolean): void {
    this.isSeated = isSeated;
    this.headset.sit(isSeated);
    this.events.seated(isSeated);
  }

  private heightText(): string {
    const height = this.events.height();
    return height === null ? "measured" : `${height.toFixed(2)} m`;
  }

  private leave(wasAsked: boolean): void {
    this.isWorn = false;
    if (wasAsked) this.events.left("You are back.", false);
    else this.events.left("The headset is off.", true);
  }
}
