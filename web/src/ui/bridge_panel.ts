/** Panel that sends to a bridge: an address, a button and the state. */

import type { Body, Skeleton } from "../body/skeleton";
import { button, element, input } from "../page";
import { Bridge, bridgeAddress } from "../server/bridge";
import { watchHash } from "../sources/watching";

const IDLE = element("bridge-hint").textContent;

export class BridgePanel {
  private bridge: Bridge | null = null;

  constructor(
    private readonly skeleton: Skeleton,
    private readonly fault: (error: unknown) => void,
  ) {
    // A link may name the bridge; whether anything is sent is the person's to say.
    input("bridge").value = new URLSearchParams(location.hash.slice(1)).get("bridge") ?? "";
    button("bridge-send").onclick = () => (this.bridge ? this.close() : this.tryOpen());
  }

  send(time: number, body: Body): void {
    this.bridge?.send(time, body);
  }

  /** Open the bridge at an address of a WebSocket. */
  open(address: string): void {
    this.close();
    this.bridge = new Bridge(address, this.skeleton, {
      opened: (session) => {
        const page = new URL(address.replace(/^ws/, "http"));
        page.pathname = page.pathname.replace(/ws$/, "");
        this.say(`Your body is sent there, live. Others watch it at ${page.href}${watchHash(session)}`);
      },
      lost: (reason, isOver) => {
        if (isOver) {
          this.close();
          this.fault(new Error(reason));
        } else this.say(reason);
      },
    });
    this.say("Looking for it …");
    button("bridge-send").textContent = "Stop sending";
    button("bridge-send").setAttribute("aria-pressed", "true");
  }

  close(): void {
    this.bridge?.close();
    this.bridge = null;
    button("bridge-send").textContent = "Send";
    button("bridge-send").setAttribute("aria-pressed", "false");
    this.say(IDLE);
  }

  private tryOpen(): void {
    try {
      this.open(bridgeAddress(input("bridge").value, location));
    } catch (error) {
      this.fault(error);
    }
  }

  private say(text: string): void {
    element("bridge-hint").textContent = text;
  }
}
