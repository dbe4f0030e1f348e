import { describe, expect, it } from "vitest";
import { History } from "../src/history";
import { Playback } from "../src/playback";
import { TRUTH } from "../src/protocol";
import { measuredText } from "../src/status";
import { pose, skeleton } from "./body";

function filled(times: readonly number[], limit?: number): History {
  const history = new History(skeleton, limit);
  times.forEach((time, sequence) => history.addPose(pose(sequence, time), 0));
  return history;
}

describe("history", () => {
  it("finds the moment at a time", () => {
    const history = filled([5, 5.1, 5.2, 5.3]); // the first is at 0 s
    expect([-1, 0, 0.05, 0.15, 0.25, 9].map((time) => history.indexAt(time))).toEqual([0, 0, 0, 1, 2, 3]);
    expect(new History(skeleton).indexAt(0)).toBe(-1);
  });

  it("goes on where a replay begins anew or leaps", () => {
    const history = filled([3.8, 3.9, 4, 0, 0.1, 2.5, 2.6]);
    const times = history.moments.map(({ time }) => time);
    expect(times).toEqual([...times].sort((a, b) => a - b));
    expect(history.moments.map(({ isJump }) => isJump)).toEqual([false, false, false, true, false, true, false]);
    expect(history.longestRun().map(({ pose: { time } }) => time)).toEqual([3.8, 3.9, 4]);
  });

  it("forgets the oldest beyond its limit", () => {
    const history = filled(
      Array.from({ length: 95 }, (_, k) => k / 60),
      50,
    );
    expect(history.moments.length).toBeLessThanOrEqual(50);
    expect(history.moments.at(-1)?.pose.sequence).toBe(94);
  });

  it("measures the distance from the truth of the same sequence only", () => {
    const history = new History(skeleton);
    const truth = { ...pose(7, 0), kind: TRUTH } as const;
    history.addTruth(truth);
    const moved = truth.rootPosition.map((value, axis) => value + (axis === 0 ? 0.1 : 0));
    history.addPose({ ...pose(7, 0), rootPosition: moved }, 0);
    history.addPose(pose(8, 0.1), 0);
    expect(history.moments[0].error).toBeCloseTo(0.1, 5);
    expect(history.moments[1].error).toBeNull();
  });

  it("times the way there and back", () => {
    const history = new History(skeleton);
    history.addSignal({ sequence: 3, time: 0, points: [] }, 100);
    history.addPose(pose(3, 0), 112);
    expect(history.moments[0].roundTrip).toBe(12);
    expect(history.moments[0].signal?.sequence).toBe(3);
  });
});

describe("playback", () => {
  it("shows the newest while live", () => {
    const history = filled([0, 0.1, 0.2]);
    expect(new Playback().step(history, 0.5)?.pose.sequence).toBe(2);
    expect(new Playback().step(new History(skeleton), 0.5)).toBeNull();
  });

  it("plays the past at its speed and catches up", () => {
    const [history, playback] = [filled([0, 0.1, 0.2, 0.3, 0.4]), new Playback()];
    playback.seek(0);
    playback.speed = 2;
    expect(playback.step(history, 0.06)?.pose.sequence).toBe(1);
    expect(playback.live).toBe(false);
    playback.step(history, 1);
    expect(playback.live).toBe(true);
  });

  it("stands still while paused, and steps by frames", () => {
    const [history, playback] = [filled([0, 0.1, 0.2, 0.3]), new Playback()];
    playback.step(history, 0);
    playback.pause();
    history.addPose(pose(4, 0.4), 0);
    expect(playback.step(history, 10)?.pose.sequence).toBe(3);
    playback.stepFrames(history, -2);
    expect(playback.step(history, 10)?.pose.sequence).toBe(1);
    playback.stepFrames(history, -9);
    expect(playback.step(history, 10)?.pose.sequence).toBe(0);
    playback.goLive();
    expect(playback.step(history, 0)?.pose.sequence).toBe(4);
  });

  it("does not fall out of a history that forgets", () => {
    const [history, playback] = [filled([0, 0.1, 0.2], 3), new Playback()];
    playback.seek(0);
    playback.pause();
    for (let k = 3; k < 9; k++) history.addPose(pose(k, k / 10), 0);
    expect(playback.step(history, 0)?.time).toBe(history.first);
  });
});

describe("what is measured", () => {
  const points = ["pelvis", "head", "left_wrist", "right_wrist", "left_knee", "right_knee"];
  const hidden = (...seen: string[]) => Uint8Array.from(points, (name) => (seen.includes(name) ? 0 : 255));

  it("is said in words where it is little", () => {
    expect(measuredText(points, null)).toBe("nothing is measured");
    expect(measuredText(points, hidden("head", "left_wrist"))).toBe("head, left wrist measured");
    expect(measuredText(points, hidden(...points))).toBe("6 points measured");
  });
});
