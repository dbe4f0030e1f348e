/** The WebSocket to the server: hello, frames both ways, and coming back after the line broke. */

import {
  POSE,
  SIGNAL,
  SUBPROTOCOL,
  TRUTH,
  VERSION,
  type ClientMessage,
  type Hello,
  type ServerMessage,
  type Welcome,
} from "./protocol";
import { readPose, readSignal, writeSignal, type PoseFrame, type SignalFrame } from "./frames";

const BACKLOG = 65_536; // bytes: while more waits to leave, newer signals are dropped rather than queued
const RETRY = { first: 500, longest: 8000 }; // ms

export interface ConnectionEvents {
  welcome(message: Welcome): void;
  signal?(frame: SignalFrame): void;
  pose?(frame: PoseFrame): void;
  truth?(frame: PoseFrame): void;
  message?(message: Exclude<ServerMessage, Welcome>): void;
  /** `retryIn`: null if the server refused with a reason, so that only the user can retry. */
  lost(reason: string, retryIn: number | null): void;
}

export class Connection {
  private socket: WebSocket | null = null;
  private points = 0;
  private wait = RETRY.first;
  private timer: ReturnType<typeof setTimeout> | undefined;
  private refusal: string | null = null;

  constructor(
    private readonly url: string,
    private readonly hello: () => Omit<Hello, "type" | "version">,
    private readonly events: ConnectionEvents,
  ) {}

  /** Open, or reopen with the current `hello`. */
  open(): void {
    this.close();
    this.refusal = null;
    const socket = new WebSocket(this.url, SUBPROTOCOL);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => socket.send(JSON.stringify({ type: "hello", version: VERSION, ...this.hello() }));
    socket.onmessage = (event: MessageEvent<unknown>) => this.receive(event.data);
    socket.onclose = (event) => this.ended(event);
    this.socket = socket;
  }

  close(): void {
    clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = null;
    this.points = 0;
    if (!socket) return;
    socket.onopen = socket.onmessage = socket.onclose = null;
    socket.close();
  }

  get isReady(): boolean {
    return this.points > 0;
  }

  send(message: ClientMessage): void {
    if (this.isReady) this.socket?.send(JSON.stringify(message));
  }

  /** Send a signal. Returns false if it was dropped because the connection is slow or not open. */
  signal(frame: SignalFrame): boolean {
    if (!this.isReady || !this.socket || this.socket.bufferedAmount > BACKLOG) return false;
    this.socket.send(writeSignal(frame));
    return true;
  }

  private receive(data: unknown): void {
    try {
      if (data instanceof ArrayBuffer) {
        if (this.points > 0) this.receiveFrame(data);
        return;
      }
      const message = JSON.parse(String(data)) as ServerMessage;
      if (message.type === "welcome") {
        this.points = message.points.length;
        this.wait = RETRY.first;
        this.events.welcome(message);
      } else {
        if (message.type === "error") this.refusal = message.reason;
        this.events.message?.(message);
      }
    } catch (error) {
      if (!(error instanceof RangeError) && !(error instanceof SyntaxError)) throw error;
      this.close();
      const reason = error instanceof SyntaxError ? "it is no message of bodysense" : error.message;
      this.events.lost(`The server sent what this page does not understand: ${reason}.`, null);
    }
  }

  private receiveFrame(buffer: ArrayBuffer): void {
    const kind = new DataView(buffer).getUint8(0);
    if (kind === SIGNAL) this.events.signal?.(readSignal(buffer));
    else if (kind === POSE) this.events.pose?.(readPose(buffer, this.points));
    else if (kind === TRUTH) this.events.truth?.(readPose(buffer, this.points));
    else throw new RangeError(`a frame of kind ${kind}`);
  }

  private ended(event: CloseEvent): void {
    this.close();
    const refusal = this.refusal ?? (event.reason || null);
    if (refusal !== null && event.code !== 1001 && event.code !== 1012) {
      this.events.lost(refusal, null);
      return;
    }
    this.events.lost(
      "No connection: is `bodysense serve` running, and does this page's address have the ?token=… that it printed?",
      this.wait,
    );
    this.timer = setTimeout(() => this.open(), this.wait);
    this.wait = Math.min(2 * this.wait, RETRY.longest);
  }
}

/** Where the server of a page is: the same host and folder, and the token of its address. */
export function socketAddress(location: Pick<Location, "href">): string {
  const address = new URL("ws", location.href);
  address.protocol = address.protocol === "https:" ? "wss:" : "ws:";
  const token = new URL(location.href).searchParams.get("token");
  if (token !== null) address.searchParams.set("token", token);
  return address.href;
}
