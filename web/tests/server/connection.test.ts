import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { Connection, socketAddress } from "../../src/server/connection";
import type { ServerMessage, Welcome } from "../../src/server/protocol";
import type { PoseFrame, SignalFrame } from "../../src/server/frames";

class FakeSocket {
  static all: FakeSocket[] = [];
  readonly sent: (string | ArrayBuffer)[] = [];
  bufferedAmount = 0;
  binaryType = "";
  isClosed = false;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;

  constructor(
    readonly url: string,
    readonly protocol: string,
  ) {
    FakeSocket.all.push(this);
  }

  send(data: string | ArrayBuffer): void {
    this.sent.push(data);
  }

  close(): void {
    this.isClosed = true;
  }

  say(message: object): void {
    this.onmessage?.({ data: JSON.stringify(message) });
  }
}

const WELCOME = { type: "welcome", points: ["pelvis", "head"], joints: ["pelvis"] };
const SIGNAL: SignalFrame = { sequence: 4, time: 1, points: [{ point: 0, position: [1, 2, 3], rotation: null }] };

function connect() {
  const heard: (Welcome | ServerMessage | SignalFrame | PoseFrame)[] = [];
  const lost: [string, number | null][] = [];
  const hear = (message: (typeof heard)[number]) => void heard.push(message);
  const connection = new Connection("ws://here/ws", () => ({ points: ["headset"] }), {
    welcome: hear,
    signal: hear,
    pose: hear,
    truth: hear,
    message: hear,
    lost: (reason, retryIn) => lost.push([reason, retryIn]),
  });
  connection.open();
  const [socket] = FakeSocket.all.slice(-1);
  socket.onopen?.();
  return { connection, socket, heard, lost };
}

beforeEach(() => {
  vi.stubGlobal("WebSocket", FakeSocket);
  vi.useFakeTimers();
});

afterEach(() => {
  vi.useRealTimers();
  vi.unstubAllGlobals();
  FakeSocket.all = [];
});

describe("the connection", () => {
  it("says hello first, and nothing else before the welcome", () => {
    const { connection, socket } = connect();
    connection.send({ type: "recentre" });
    expect(connection.signal(SIGNAL)).toBe(false);
    expect(socket.protocol).toBe("bodysense.1");
    expect(socket.sent.map((text) => JSON.parse(String(text)) as unknown)).toEqual([
      { type: "hello", version: 1, points: ["headset"] },
    ]);
    socket.say(WELCOME);
    expect(connection.signal(SIGNAL)).toBe(true);
  });

  it("drops signals while older ones wait to leave", () => {
    const { connection, socket } = connect();
    socket.say(WELCOME);
    socket.bufferedAmount = 1e6;
    expect(connection.signal(SIGNAL)).toBe(false);
    socket.bufferedAmount = 0;
    expect(connection.signal(SIGNAL)).toBe(true);
  });

  it("comes back after the line broke, ever more slowly, and at once slow no more after a welcome", () => {
    const { socket, lost } = connect();
    socket.onclose?.({ code: 1006, reason: "" });
    for (let k = 0; k < 6; k++) {
      vi.advanceTimersByTime(lost.at(-1)?.[1] ?? NaN);
      FakeSocket.all.at(-1)?.onclose?.({ code: 1006, reason: "" });
    }
    expect(lost.map(([, wait]) => wait)).toEqual([500, 1000, 2000, 4000, 8000, 8000, 8000]);
    vi.advanceTimersByTime(8000);
    FakeSocket.all.at(-1)?.say(WELCOME);
    FakeSocket.all.at(-1)?.onclose?.({ code: 1006, reason: "" });
    expect(lost.at(-1)?.[1]).toBe(500);
  });

  it("waits for the person where the server refused for a reason", () => {
    const { socket, lost } = connect();
    socket.say({ type: "error", reason: "too many sessions; close one" });
    socket.onclose?.({ code: 1013, reason: "" });
    vi.advanceTimersByTime(60_000);
    expect(lost).toEqual([["too many sessions; close one", null]]);
    expect(FakeSocket.all.length).toBe(1);
  });

  it.each([
    ["text that is no JSON", "{"],
    ["a frame of an unknown kind", Uint8Array.from({ length: 40 }, () => 9).buffer],
    ["a pose that is cut short", Uint8Array.from([2, 0, 52, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]).buffer],
    ["nothing", new ArrayBuffer(0)],
  ])("closes on %s, with a line for the person", (_, data) => {
    const { socket, lost } = connect();
    socket.say(WELCOME);
    socket.onmessage?.({ data });
    expect(socket.isClosed).toBe(true);
    expect(lost).toEqual([
      [expect.stringMatching(/^The server sent what this page does not understand: [^\n]+$/), null],
    ]);
  });
});

describe("the address of the socket", () => {
  it.each([
    ["http://127.0.0.1:8765/", "ws://127.0.0.1:8765/ws"],
    ["https://example.org/body/?token=a%26b&x=1#top", "wss://example.org/body/ws?token=a%26b"],
  ])("of %s is %s", (page, socket) => {
    expect(socketAddress({ href: page })).toBe(socket);
  });
});
