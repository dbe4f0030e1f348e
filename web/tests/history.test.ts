import { describe, expect, it } from "vitest";
import { History, type Moment } from "../src/history";
import { Playback } from "../src/playback";
import { Take } from "../src/take";
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

describe("a take", () => {
  it("is what came between two presses, and survives a history that is cleared", () => {
    const history = filled([0, 0.1, 0.2]);
    const take = new Take(history);
    take.toggle();
    [0.3, 0.4, 0.5].forEach((time, k) => history.add(moment(3 + k, time)));
    take.toggle();
    history.clear();
    expect(take.toSave().map(({ rootPosition }) => rootPosition[0])).toEqual([2, 3, 4, 5]);
    expect(take.seconds).toBeCloseTo(0.3, 6);
  });

  it("ends where its source goes away, and is the whole timeline where nothing was recorded", () => {
    const history = filled([0, 0.1]);
    const take = new Take(history);
    take.end();
    expect(take.toSave().map(({ rootPosition }) => rootPosition[0])).toEqual([0, 1]);
    take.toggle();
    history.add(moment(2, 0.2));
    take.end();
    expect([take.isRecording, take.toSave().map(({ rootPosition }) => rootPosition[0])]).toEqual([false, [1, 2]]);
  });

  it("is kept in parts, and is longer than the timeline", () => {
    const history = new History(50);
    const kept: [number, boolean][] = [];
    const take = new Take(history, { add: (frames, isFirst) => kept.push([frames.length, isFirst]) });
    history.add(moment(0, 0));
    take.toggle();
    for (let k = 1; k < 700; k++) history.add(moment(k, k / 100));
    take.toggle();
    expect(kept).toEqual([
      [300, true],
      [300, false],
      [100, false],
    ]);
    expect(take.toSave()).toHaveLength(700);
    take.restore([]);
    expect(take.seconds).toBeCloseTo(6.99, 6);
  });

  it("keeps the one before where nothing was recorded", () => {
    const history = filled([0, 0.1]);
    const take = new Take(history);
    take.restore(history.moments.slice());
    history.clear();
    take.toggle();
    take.toggle();
    expect(take.toSave()).toHaveLength(2);
  });
});
