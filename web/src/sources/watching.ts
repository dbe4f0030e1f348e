/** The wearers of a server: the camera follows the first, the others are next to it. */

import { Group, type Object3D } from "three";
import { History } from "../takes/history";
import type { Resume } from "../server/protocol";
import { Bodies, type DisplaySettings } from "../view/bodies";
import { ServerSource, type ServerEvents, type Watched } from "./server_source";
import type { Source } from "./source";

const APART = 1.1; // m between two wearers
const LOOK: DisplaySettings = { figure: "figure", colouring: "plain", truth: false, signal: false, ghosts: false };

/** Return the sessions named in a link, `#watch=SESSION:TOKEN,…`. */
export function followedBy(hash: string): readonly Resume[] {
  const named = new URLSearchParams(hash.replace(/^#/, "")).get("watch") ?? "";
  return named
    .split(",")
    .map((pair) => pair.split(":", 2))
    .flatMap(([session, token]) => (session && token ? [{ session, token }] : []));
}

/** Return the hash of a link that lets others watch a session. */
export function watchHash({ session, token }: Resume): string {
  return `#watch=${session}:${token}`;
}

/** A further wearer next to the first. */
class Companion {
  private readonly place = new Group();
  private readonly history = new History(2);
  private readonly bodies = new Bodies(this.place);
  private readonly source: ServerSource;

  constructor(
    address: string,
    watched: Watched,
    number: number,
    stage: Object3D,
    came: () => void,
    over: (companion: Companion, reason: string) => void,
  ) {
    this.place.position.x = APART * Math.ceil(number / 2) * (number % 2 === 1 ? 1 : -1); // left, right, left …
    stage.add(this.place);
    this.source = new ServerSource(address, this.history, watched, {
      came,
      lost: (reason, again) => again && over(this, reason),
    });
  }

  get isThere(): boolean {
    return this.history.moments.length > 0 && !this.source.isSilent;
  }

  draw(): void {
    const moment = this.history.moments.at(-1);
    this.place.visible = this.isThere;
    const { skeleton } = this.source;
    if (moment && skeleton && this.isThere) this.bodies.show(moment, skeleton, LOOK, 0);
  }

  stop(): void {
    this.source.stop();
    this.bodies.clear();
    this.place.removeFromParent();
  }
}

/** All watched wearers of a server. */
export class Watching implements Source {
  readonly first: ServerSource;
  private companions: Companion[] = [];

  /** `followed`: sessions of other clients; empty: the server's own inputs. */
  constructor(
    private readonly address: string,
    history: History,
    private readonly stage: Object3D,
    private readonly events: Omit<ServerEvents, "others">,
    followed: readonly Resume[],
  ) {
    const [first, ...others] = followed.map((follow): Watched => ({ follow }));
    this.first = new ServerSource(address, history, first ?? null, {
      ...events,
      others: (inputs) => this.invite(inputs.map((watch) => ({ watch }))),
    });
    this.invite(others);
  }

  get title(): string {
    const count = this.companions.filter(({ isThere }) => isThere).length;
    const title = this.first.isSilent ? `${this.first.title}, silent now` : this.first.title;
    return count > 0 ? `${title}, and ${count} more` : title;
  }

  get sensors(): readonly string[] {
    return this.first.sensors;
  }

  get trackers(): readonly string[] {
    return this.first.trackers;
  }

  frame(): void {
    for (const companion of this.companions) companion.draw();
  }

  stop(): void {
    this.first.stop();
    for (const companion of this.companions.splice(0)) companion.stop();
  }

  private invite(others: readonly Watched[]): void {
    for (const watched of others) {
      const number = this.companions.length + 1;
      this.companions.push(
        new Companion(this.address, watched, number, this.stage, this.events.came, (companion, reason) => {
          companion.stop();
          this.companions = this.companions.filter((other) => other !== companion);
          this.events.notified?.(`One wearer is gone: ${reason}.`);
        }),
      );
    }
  }
}
