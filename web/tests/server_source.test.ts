/** A server as a source, against a fake socket. */

import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { History } from "../src/history";
import { POSE, type Welcome } from "../src/protocol";
import { ServerSource } from "../src/sources/server_source";
import { skeleton } from "./body";

class FakeSocket {
  static all: FakeSocket[] = [];
  readonly sent: string[] = [];
  bufferedAmount = 0;
  onopen: (() => void) | null = null;
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onclose: ((event: { code: number; reason: string }) => void) | null = null;
  constructor() {
    FakeSocket.all.push(this);
  }
  send(data: string): void {
    this.sent.push(data);
  }
  close(): void {
    this.onclose = null;
  }
  say(data: unknown): void {
    this.onmessage?.({ data });
  }
}

const { points, parents, joints, restOffset } = skeleton;
const WELCOME = {
  type: "welcome",
  session: "s1",
  token: "t1",
  joints: points.slice(0, joints),
  points,
  parents,
  rest_offset: points.map((_, point) => [...restOffset.subarray(3 * point, 3 * point + 3)]),
  signal: ["head"],
  sources: ["replay"],
} as unknown as Welcome;

function poseBytes(time: number): ArrayBuffer {
  const bytes = new DataView(new ArrayBuffer(16 + 12 + 16 * joints + 5 * points.length + 8));
  bytes.setUint8(0, POSE);
  bytes.setUint16(2, joints, true);
  bytes.setFloat64(8, time, true);
  for (let joint = 0; joint < joints; joint++) bytes.setFloat32(28 + 16 * joint, 1, true);
  return bytes.buffer;
}

beforeEach(() => {
  vi.stubGlobal("WebSocket", FakeSocket);
  vi.useFakeTimers();
});
afterEach(() => {
  vi.unstubAllGlobals();
  vi.useRealTimers();
});

describe("a server", () => {
  it("is asked for its input, shows it, and is said to be gone when it is", () => {
    const history = new History();
    const [said, lost] = [vi.fn(), vi.fn()];
    const source = new ServerSource("http://here:1/", history, { skeleton: vi.fn(), connected: vi.fn(), said, lost });
    const hello = () => {
      const socket = FakeSocket.all.at(-1) ?? new FakeSocket();
      socket.onopen?.();
      return { socket, asked: JSON.parse(socket.sent[0] ?? "{}") as Record<string, unknown> };
    };
    const first = hello();
    expect([first.asked["watch"], first.asked["resume"]]).toEqual([null, null]);
    first.socket.say(JSON.stringify(WELCOME));
    const second = hello();
    expect([second.asked["watch"], second.asked["resume"]]).toEqual(["replay", null]);
    second.socket.say(JSON.stringify(WELCOME));
    second.socket.say(poseBytes(0.5));
    expect([history.moments.length, source.title, said.mock.calls.length]).toEqual([1, "The server's own input", 0]);
    second.socket.onclose?.({ code: 1006, reason: "" });
    expect(source.title).toBe("The server does not answer");
    expect(lost).toHaveBeenCalledWith(expect.stringContaining("is `bodysense serve` running"), false);
    vi.advanceTimersByTime(600);
    expect(hello().asked["resume"]).toEqual({ session: "s1", token: "t1" });
    expect(history.moments.length).toBe(1); // the timeline stays
    source.stop();
  });

  it("without an input says which doors there are", () => {
    const said = vi.fn();
    const events = { skeleton: vi.fn(), connected: vi.fn(), said, lost: vi.fn() };
    const source = new ServerSource("http://here:1/", new History(), events);
    FakeSocket.all.at(-1)?.say(JSON.stringify({ ...WELCOME, sources: [] }));
    expect(said).toHaveBeenCalledWith(
      expect.stringMatching(/^The server has no input of its own; start it with[^\n]*$/),
    );
    source.stop();
  });
});
