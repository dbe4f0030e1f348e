/** The clock of a motion, and what the page takes from the page around it. */

import { describe, expect, it } from "vitest";
import { commandFrom, originOf } from "../src/embed/embedder";
import { Rounds } from "../src/sources/rounds";

describe("the clock of a motion", () => {
  const times = (rounds: Rounds, milliseconds: readonly number[]): (number | null)[] =>
    milliseconds.map((at) => (rounds.advance(at) ? rounds.time : null));

  it("gives its first frame although it is paused, then none", () => {
    const rounds = new Rounds(3);
    rounds.pause();
    expect(times(rounds, [5, 10, 20])).toEqual([0, null, null]);
  });

  it("repeats, with a rest on the clock of observations", () => {
    const ends: number[] = [];
    const rounds = new Rounds(1, (clock) => ends.push(clock));
    expect(times(rounds, [0, 600, 1200, 1700])).toEqual([0, 0.6, 0, 0.5]);
    expect(ends).toEqual([1]);
    expect(rounds.clock(0.5)).toBe(3.5);
    expect([rounds.timeAt(0.6), rounds.timeAt(3.5)]).toEqual([null, 0.5]);
  });

  it("ends at its last frame where it does not repeat, and plays again from the beginning", () => {
    const rounds = new Rounds(1);
    rounds.play(false);
    expect(times(rounds, [0, 900, 1800, 2700])).toEqual([0, 0.9, 1, null]);
    expect(rounds.isPlaying).toBe(false);
    rounds.play(true);
    expect(times(rounds, [2800, 2900])).toEqual([0.1, 0.2].map((time) => expect.closeTo(time, 9)));
  });

  it("jumps while it is paused, never beyond the motion, and its clock never goes back", () => {
    const rounds = new Rounds(5);
    rounds.advance(0);
    rounds.pause();
    let clock = rounds.clock(rounds.time);
    for (const [time, got] of [[4, 4] as const, [-1, 0] as const, [99, 5] as const, [2, 2] as const]) {
      rounds.seek(time);
      expect(times(rounds, [100, 200])).toEqual([got, null]);
      expect(rounds.clock(rounds.time)).toBeCloseTo(clock + 2, 9);
      expect(rounds.timeAt(clock)).toBeNull(); // a frame from before the jump
      clock = rounds.clock(rounds.time);
    }
  });

  it("goes on where it was after the page was hidden", () => {
    expect(times(new Rounds(60), [0, 40_000])).toEqual([0, 1]);
  });

  it("gives a frame again that was left out, and a motion of one frame", () => {
    const rounds = new Rounds(0);
    rounds.pause();
    expect(rounds.advance(0)).toBe(true);
    rounds.again();
    expect(rounds.advance(10)).toBe(true);
    expect(rounds.length).toBe(1);
  });
});

describe("the page around this one", () => {
  it("is known by its referrer, or by name", () => {
    expect(originOf("", "https://example.org/shop?x=1")).toBe("https://example.org");
    expect(originOf("https://one.org", "https://other.org/")).toBe("https://one.org");
    expect(originOf("*", "")).toBe("*");
    for (const [named, referrer] of [["", ""] as const, ["", "about:blank"] as const])
      expect(() => originOf(named, referrer)).toThrow("name its origin, as in ?embed=https://example.org");
    expect(() => originOf("example.org", "https://example.org/")).toThrow("embed=example.org: give an origin such as");
  });

  it("sends commands that are checked, and other messages that are not ours", () => {
    const good = [
      { bodysense: "hello" },
      { bodysense: "play" },
      { bodysense: "play", repeat: false },
      { bodysense: "pause" },
      { bodysense: "seek", time: 0 },
      { bodysense: "load", motion: "walk.bvh", avatar: new File([], "me.vrm") },
      { bodysense: "background", transparent: true },
    ];
    for (const command of good) expect(commandFrom(command)).toEqual(command);
    for (const other of [null, 7, "play", { type: "play" }, []]) expect(commandFrom(other)).toBeNull();
  });

  it.each([
    [{ bodysense: "dance" }, "dance: no such command; send one of hello, play, pause, seek, load, background."],
    [{ bodysense: 3 }, "3: no such command"],
    [{ bodysense: "seek" }, "seek: time is undefined; give seconds from the motion's beginning."],
    [{ bodysense: "seek", time: NaN }, "seek: time is NaN; give seconds"],
    [{ bodysense: "seek", time: "1" }, "seek: time is 1; give seconds"],
    [{ bodysense: "play", repeat: 1 }, "play: repeat is 1; give true or false."],
    [{ bodysense: "background", transparent: "yes" }, "background: transparent is yes; give true or false."],
    [{ bodysense: "load" }, "load: motion is undefined; give an address or a File as motion, avatar or both."],
    [{ bodysense: "load", avatar: {} }, "load: avatar is [object Object]; give an address or a File."],
  ])("sends %j, which is refused in one line", (command, reason) => {
    expect(() => commandFrom(command)).toThrow(reason);
  });
});
