import { describe, expect, it } from "vitest";
import { History, type Moment } from "../src/takes/history";
import { Playback } from "../src/takes/playback";
import { TakeSource } from "../src/sources/take_source";
import { partOf, Takes, type Description } from "../src/takes/takes";
import { moment } from "./body";

const numberOf = (found: Moment | null | undefined): number | undefined => found?.rootPosition[0];

function filled(times: readonly number[], limit?: number): History {
  const history = new History(limit);
  times.forEach((time, number) => history.add(moment(number, time)));
  return history;
}

describe("history", () => {
  it("finds the moment at a time", () => {
    const history = filled([5, 5.1, 5.2, 5.3]); // the first is at 0 s
    expect([-1, 0, 0.05, 0.15, 0.25, 9].map((time) => history.indexAt(time))).toEqual([0, 0, 0, 1, 2, 3]);
    expect(new History().indexAt(0)).toBe(-1);
  });

  it("goes on where a replay begins anew or leaps", () => {
    const history = filled([3.8, 3.9, 4, 0, 0.1, 2.5, 2.6]);
    const times = history.moments.map(({ time }) => time);
    expect(times).toEqual([...times].sort((a, b) => a - b));
    expect(history.moments.map(({ isJump }) => isJump)).toEqual([false, false, false, true, false, true, false]);
    expect(history.longestRun().map(({ sourceTime }) => sourceTime)).toEqual([3.8, 3.9, 4]);
  });

  it("forgets the oldest beyond its limit", () => {
    const history = filled(
      Array.from({ length: 95 }, (_, k) => k / 60),
      50,
    );
    expect(history.moments.length).toBeLessThanOrEqual(50);
    expect(numberOf(history.moments.at(-1))).toBe(94);
  });
});

describe("playback", () => {
  it("shows the newest while live", () => {
    const history = filled([0, 0.1, 0.2]);
    expect(numberOf(new Playback().step(history, 0.5))).toBe(2);
    expect(new Playback().step(new History(), 0.5)).toBeNull();
  });

  it("plays the past at its speed and catches up", () => {
    const [history, playback] = [filled([0, 0.1, 0.2, 0.3, 0.4]), new Playback()];
    playback.seek(0);
    playback.speed = 2;
    expect(numberOf(playback.step(history, 0.06))).toBe(1);
    expect(playback.live).toBe(false);
    playback.step(history, 1);
    expect(playback.live).toBe(true);
  });

  it("stands still while paused, and steps by frames", () => {
    const [history, playback] = [filled([0, 0.1, 0.2, 0.3]), new Playback()];
    playback.step(history, 0);
    playback.pause();
    history.add(moment(4, 0.4));
    expect(numberOf(playback.step(history, 10))).toBe(3);
    playback.stepFrames(history, -2);
    expect(numberOf(playback.step(history, 10))).toBe(1);
    playback.stepFrames(history, -9);
    expect(numberOf(playback.step(history, 10))).toBe(0);
    playback.goLive();
    expect(numberOf(playback.step(history, 0))).toBe(4);
  });

  it("does not fall out of a history that forgets", () => {
    const [history, playback] = [filled([0, 0.1, 0.2], 3), new Playback()];
    playback.seek(0);
    playback.pause();
    for (let k = 3; k < 9; k++) history.add(moment(k, k / 10));
    expect(playback.step(history, 0)?.time).toBe(history.first);
  });
});

describe("takes", () => {
  const numbersOf = (takes: Takes): (number | undefined)[] => takes.toSave().map((frame) => frame.rootPosition[0]);
  const recorded = (takes: Takes, history: History, from: number, to: number): void => {
    takes.toggle();
    for (let k = from; k <= to; k++) history.add(moment(k, k / 10));
    takes.toggle();
  };

  it("are what came between two presses, and survive a history that is cleared", () => {
    const history = filled([0, 0.1, 0.2]);
    const takes = new Takes(history);
    recorded(takes, history, 3, 5);
    history.clear();
    expect(numbersOf(takes)).toEqual([2, 3, 4, 5]);
    expect(partOf(takes.all[0])[1]).toBeCloseTo(0.3, 6);
  });

  it("end where their source goes away; without one the timeline is saved", () => {
    const history = filled([0, 0.1]);
    const takes = new Takes(history);
    takes.end();
    expect(numbersOf(takes)).toEqual([0, 1]);
    takes.toggle();
    history.add(moment(2, 0.2));
    takes.end();
    expect([takes.isRecording, numbersOf(takes)]).toEqual([false, [1, 2]]);
  });

  it("are several, with names that nobody has yet, and the last one is chosen", () => {
    const history = filled([0]);
    const takes = new Takes(history, undefined, () => 7);
    recorded(takes, history, 1, 2);
    recorded(takes, history, 3, 4);
    takes.remove(takes.all[0].id);
    recorded(takes, history, 5, 6);
    expect(takes.all.map(({ name }) => name)).toEqual(["Take 2", "Take 3"]);
    expect(new Set(takes.all.map(({ id }) => id)).size).toBe(2); // though the clock stands still
    expect(numbersOf(takes)).toEqual([4, 5, 6]);
    takes.choose(takes.all[0].id);
    expect(numbersOf(takes)).toEqual([2, 3, 4]);
    for (const { id } of takes.all) takes.remove(id);
    expect([takes.chosen, takes.all]).toEqual([null, []]);
  });

  it("are cut without loss, and what a person decides is kept", () => {
    const history = filled([0]);
    const stored: Description[] = [];
    const keeper = {
      add: () => undefined,
      describe: (one: Description) => void stored.push(one),
      remove: () => undefined,
    };
    const takes = new Takes(history, keeper);
    recorded(takes, history, 1, 9);
    const { id } = takes.all[0];
    takes.describe(id, { name: "Walk", part: [0.25, 0.55] });
    expect(numbersOf(takes)).toEqual([3, 4, 5]);
    expect(stored.at(-1)).toMatchObject({ id, name: "Walk", part: [0.25, 0.55] });
    takes.describe(id, { part: null });
    expect(numbersOf(takes)).toHaveLength(10);
    expect(takes.chosen?.name).toBe("Walk");
  });

  it("are kept in parts, and are longer than the timeline", () => {
    const history = new History(50);
    const kept: number[] = [];
    const keeper = {
      add: (_: number, { length }: { length: number }) => void kept.push(length),
      describe: () => undefined,
    };
    const takes = new Takes(history, { ...keeper, remove: () => undefined });
    history.add(moment(0, 0));
    takes.toggle();
    for (let k = 1; k < 700; k++) history.add(moment(k, k / 100));
    takes.toggle();
    expect(kept).toEqual([300, 300, 100]);
    expect(takes.toSave()).toHaveLength(700);
  });

  it("of earlier visits come before those of this one, and a press without frames is no take", () => {
    const history = filled([0, 0.1]);
    const takes = new Takes(history);
    recorded(takes, history, 2, 3);
    takes.restore([{ id: 1, name: "Take 1", frames: history.moments.slice(0, 2), part: null }]);
    expect(takes.all.map(({ id }) => id === 1)).toEqual([true, false]);
    expect(numbersOf(takes)).toEqual([1, 2, 3]); // the one of this visit stays chosen
    history.clear();
    takes.toggle();
    takes.toggle();
    expect(takes.all).toHaveLength(2);
  });
});

describe("a take on the stage", () => {
  it("repeats the part that counts, and stands still where it is paused", () => {
    const history = filled(Array.from({ length: 21 }, (_, k) => k / 10));
    const take = { id: 1, name: "Walk", frames: history.moments, part: [0.5, 1] as const };
    const playback = new Playback();
    const source = new TakeSource(() => take, playback);
    source.frame();
    const seen = new Set<number | undefined>();
    for (let k = 0; k < 20; k++) {
      seen.add(numberOf(playback.step(history, 0.1)));
      source.frame();
    }
    const places = [...seen].map((number) => number ?? Number.NaN);
    expect([Math.min(...places) >= 5, Math.max(...places) <= 11, places.length >= 5]).toEqual([true, true, true]);
    playback.seek(1.7);
    playback.pause();
    source.frame();
    expect(playback.time).toBe(1.7);
  });
});
