/** A server as a source, against a fake socket. */

import { Group } from "three";
import { afterEach, beforeEach, describe, expect, it, vi } from "vitest";
import { History } from "../../src/takes/history";
import { POSE, type Welcome } from "../../src/server/protocol";
import { ServerSource } from "../../src/sources/server_source";
import { followedBy, Watching, watchHash } from "../../src/sources/watching";
import { skeleton } from "../body";

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
  settings: { worn: [{ tracker: "tracker_1", joint: "left_knee" }] },
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

const silent = () => ({
  skeleton: vi.fn(),
  connected: vi.fn(),
  came: vi.fn(),
  empty: vi.fn(),
  notified: vi.fn(),
  lost: vi.fn(),
  others: vi.fn(),
});

describe("several wearers", () => {
  it("are named by a link", () => {
    const [a, b] = [
      { session: "s1", token: "t-1_" },
      { session: "s2", token: "t2" },
    ];
    expect(followedBy(watchHash(a))).toEqual([a]);
    expect(followedBy(`${watchHash(a)},s2:t2`)).toEqual([a, b]);
    for (const hash of ["", "#", "#watch=", "#watch=s1", "#watch=:t1", "#bridge=ws://a:1"])
      expect(followedBy(hash)).toEqual([]);
  });

  it("of one server stand on one stage, and one that leaves is reported", () => {
    const stage = new Group();
    const events = silent();
    FakeSocket.all.length = 0;
    const watching = new Watching("http://here:1/", new History(), stage, events, []);
    FakeSocket.all[0]?.say(JSON.stringify({ ...WELCOME, sources: ["vmc", "markers"] }));
    const requested = FakeSocket.all.slice(1).map((socket) => {
      socket.onopen?.();
      socket.say(JSON.stringify(WELCOME));
      socket.say(poseBytes(0.5));
      return (JSON.parse(socket.sent[0] ?? "{}") as Record<string, unknown>)["watch"];
    });
    expect(new Set(requested)).toEqual(new Set(["vmc", "markers"]));
    watching.frame();
    expect(watching.title).toBe("The server's own input, and 1 more");
    expect(stage.children).toHaveLength(1);
    expect(events.came).toHaveBeenCalled();
    const [watched, other] = ["vmc", "markers"].map((name) => FakeSocket.all[requested.indexOf(name) + 1]);
    vi.advanceTimersByTime(6000);
    watched?.say(poseBytes(6));
    expect(watching.title).toBe("The server's own input"); // the other one is silent
    watching.frame();
    expect(stage.children[0]?.visible).toBe(false);
    other?.say(poseBytes(6));
    expect(watching.title).toBe("The server's own input, and 1 more");
    other?.onclose?.({ code: 1008, reason: "the session that was watched is over" });
    expect(events.notified).toHaveBeenCalledWith("One wearer is gone: the session that was watched is over.");
    expect([watching.title, stage.children.length]).toEqual(["The server's own input", 0]);
    watching.stop();
  });
});

describe("a server", () => {
  it("sends its input, which is displayed, and its end is reported", () => {
    const history = new History();
    const [notified, lost] = [vi.fn(), vi.fn()];
    const source = new ServerSource("http://here:1/", history, null, { ...silent(), notified, lost });
    const hello = () => {
      const socket = FakeSocket.all.at(-1) ?? new FakeSocket();
      socket.onopen?.();
      return { socket, requested: JSON.parse(socket.sent[0] ?? "{}") as Record<string, unknown> };
    };
    const first = hello();
    expect([first.requested["watch"], first.requested["resume"]]).toEqual([null, null]);
    first.socket.say(JSON.stringify(WELCOME));
    const second = hello();
    expect([second.requested["watch"], second.requested["resume"]]).toEqual(["replay", null]);
    second.socket.say(JSON.stringify(WELCOME));
    second.socket.say(poseBytes(0.5));
    expect([history.moments.length, source.title, notified.mock.calls.length]).toEqual([
      1,
      "The server's own input",
      0,
    ]);
    second.socket.onclose?.({ code: 1006, reason: "" });
    expect(source.title).toBe("The server does not answer");
    expect(lost).toHaveBeenCalledWith(expect.stringContaining("is `bodysense serve` running"), false);
    vi.advanceTimersByTime(600);
    expect(hello().requested["resume"]).toEqual({ session: "s1", token: "t1" });
    expect(history.moments.length).toBe(1); // the timeline stays
    source.stop();
  });

  it("lets who follows another's session change nothing", () => {
    const follow = { session: "s9", token: "w9" };
    const source = new ServerSource("http://here:1/", new History(), { follow }, silent());
    const socket = FakeSocket.all.at(-1);
    socket?.onopen?.();
    socket?.say(JSON.stringify({ ...WELCOME, token: "" }));
    source.updateSettings({ hidden: ["head"] });
    expect(socket?.sent).toHaveLength(1);
    expect(JSON.parse(socket?.sent[0] ?? "{}")).toMatchObject({ watch: null, follow, resume: null });
    expect(source.title).toBe("Another wearer");
    source.stop();
  });

  it("without an input says so, and nobody comes", () => {
    const events = silent();
    const source = new ServerSource("http://here:1/", new History(), null, events);
    FakeSocket.all.at(-1)?.say(JSON.stringify({ ...WELCOME, sources: [] }));
    expect([events.empty.mock.calls.length, events.came.mock.calls.length]).toEqual([1, 0]);
    source.stop();
  });
});
