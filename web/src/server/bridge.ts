/** Bridge: sends whole bodies to a bodysense server, which passes them to programs that a page cannot reach. */

import type { Body, Skeleton } from "../body/skeleton";
import { quaternionAt, vectorAt } from "../body/math";
import type { Resume } from "./protocol";
import { Connection, socketAddress } from "./connection";

const EXAMPLE = "ws://127.0.0.1:8765/?token=…";

export interface BridgeEvents {
  /** It takes bodies; by this session others watch them. */
  opened(session: Resume): void;
  /** The bridge is unreachable. `isOver`: it refused, so the page does not try again. */
  lost(reason: string, isOver: boolean): void;
}

/** Return the address of a bridge from typed text. Throws an Error of one line if it is invalid or unreachable. */
export function bridgeAddress(text: string, page: Pick<Location, "protocol">): string {
  const typed = text.trim();
  const found = URL.parse(/^\w+:\/\//.test(typed) ? typed : `ws://${typed}`);
  if (!found || !/^(ws|http)s?:$/.test(found.protocol) || /\s/.test(typed) || typed === "")
    throw new Error(
      `“${typed}” is no address of a bridge: paste what \`bodysense serve --bridge\` printed, as ${EXAMPLE}`,
    );
  found.protocol = found.protocol.replace("ws", "http");
  const isNear = /^(localhost|127(\.\d+){3}|\[::1\])$/.test(found.hostname);
  if (page.protocol === "https:" && found.protocol === "http:" && !isNear)
    throw new Error(
      "A page by https reaches a bridge on another machine by wss:// only: start `bodysense serve --bridge --lan`.",
    );
  return socketAddress(found);
}

export class Bridge {
  private sequence = 0;
  private wasWelcome = false;
  private isAsking = false; // why it does not answer
  private readonly over = new AbortController();
  private readonly connection: Connection;

  /** `address`: of the server's WebSocket; bodies are those of a skeleton with these joints. */
  constructor(
    private readonly address: string,
    private readonly skeleton: Pick<Skeleton, "points" | "joints">,
    private readonly events: BridgeEvents,
  ) {
    const points = skeleton.points.slice(0, skeleton.joints);
    this.connection = new Connection(
      address,
      // Feet were held here already.
      () => ({ name: "page", points, settings: { hold_feet: false }, watch: null, resume: null }),
      {
        welcome: ({ session, watch_token }) => {
          this.wasWelcome = true;
          events.opened({ session, token: watch_token });
        },
        lost: (reason, retryIn) => {
          if (retryIn === null) events.lost(`The bridge refused: ${reason}`, true);
          else {
            events.lost("No bridge answers there; the page keeps trying.", false);
            if (!this.wasWelcome) void this.askWhy();
          }
        },
      },
    );
    this.connection.open();
  }

  /** Send a body as of `time` s; dropped if the connection is slow or not open. */
  send(time: number, { position, rotation }: Body): void {
    const points = Array.from({ length: this.skeleton.joints }, (_, point) => ({
      point,
      position: vectorAt(position, point),
      rotation: quaternionAt(rotation, point),
    }));
    this.connection.signal({ sequence: this.sequence++, time, points });
  }

  close(): void {
    this.over.abort();
    this.connection.close();
  }

  /** Distinguish a wrong token from a missing bridge by a plain request: a WebSocket reports no reason. */
  private async askWhy(): Promise<void> {
    if (this.isAsking) return;
    this.isAsking = true;
    const place = new URL(this.address.replace(/^ws/, "http"));
    place.search = "";
    const { signal } = this.over;
    const answers = await fetch(place, { mode: "no-cors", cache: "no-store", signal }).then(
      () => true,
      () => false,
    );
    this.isAsking = false;
    if (!answers || this.wasWelcome || signal.aborted) return;
    this.close();
    this.events.lost(
      "Something answers there, but not to this token: paste the address that `bodysense serve --bridge` prints now.",
      true,
    );
  }
}
