/** Dropped files: motions of many rigs, recordings, and other files. */

import { describe, expect, it } from "vitest";
import { bodyAt } from "../../src/body/clip";
import { readBvh } from "../../src/files/bvh_read";
import { openFile } from "../../src/files/open";
import { recordingOfLines } from "../../src/files/recording";
import { clipOf, jointsOf } from "../../src/files/rig";
import { History } from "../../src/takes/history";
import { bvhText } from "../../src/out/bvh";
import { resample } from "../../src/out/resample";
import { moment, skeleton } from "../body";

const file = (name: string, content: string | Uint8Array<ArrayBuffer>) => Object.assign(new Blob([content]), { name });

/** Return our BVH of a standing person who bows a little. */
function ownBvh(): string {
  const history = new History();
  [0, 0.05, 0.1, 0.15].forEach((time, k) => history.add(moment(k, time, 0.15)));
  return bvhText(skeleton, resample(history.moments, skeleton.joints));
}

const DOG = `HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
  JOINT Tail
  {
    OFFSET 0 5 -30
    CHANNELS 3 Zrotation Xrotation Yrotation
    End Site
    {
      OFFSET 0 0 -20
    }
  }
}
MOTION
Frames: 2
Frame Time: 0.0333
0 50 0 0 0 0 0 0 0
0 50 0 0 0 0 0 0 0
`;

/** An animal whose joints have a person's names, as data sets of dogs have them: +Y is up, the head is ahead. */
function namedDog(): string {
  const joint = (kind: string, name: string, offset: string, inside = ""): string =>
    `${kind} ${name}\n{\nOFFSET ${offset}\nCHANNELS 3 Zrotation Xrotation Yrotation\n${inside}}\n`;
  const chain = (rows: readonly (readonly [string, string])[]): string =>
    rows.reduceRight((inside, [name, offset]) => joint("JOINT", name, offset, inside), "");
  const limbs = ["Left", "Right"].map((side, k) => {
    const x = k === 0 ? 8 : -8;
    const leg = [`${side}UpLeg`, `${x} -5 0`, `${side}Leg`, "0 -38 8", `${side}Foot`, "0 -38 -12"];
    const arm = [`${side}Arm`, `${x} -8 5`, `${side}ForeArm`, "0 -36 -8", `${side}Hand`, "0 -40 4"];
    return [leg, arm].map((rows) => chain([0, 2, 4].map((row) => [rows[row], rows[row + 1]])));
  });
  const head = chain([
    ["Neck", "0 10 15"],
    ["Head", "0 15 20"],
  ]);
  const spine = joint("JOINT", "Spine", "0 5 60", limbs.map(([, arm]) => arm).join("") + head);
  const whole = joint(
    "ROOT",
    "Hips",
    "0 85 0",
    limbs.map(([leg]) => leg).join("") + spine + chain([["Tail", "0 0 -30"]]),
  );
  const still = Array(3 * 17)
    .fill(0)
    .join(" ");
  return `HIERARCHY\n${whole}MOTION\nFrames: 2\nFrame Time: 0.0333\n${still}\n${still}\n`;
}

describe("a BVH", () => {
  it("whose person lies, and whose rest pose stands, is not stood upright", () => {
    const history = new History();
    [0, 0.05, 0.1].forEach((time, k) => {
      const lying = moment(k, time, 0.1);
      lying.rotation.set([Math.SQRT1_2, -Math.SQRT1_2, 0, 0]);
      history.add(lying);
    });
    const text = bvhText(skeleton, resample(history.moments, skeleton.joints));
    expect(() => clipOf(readBvh(text, "sleeper.bvh"), skeleton)).toThrow(/^sleeper\.bvh lies down [^\n]*$/);
  });

  it("of our own comes back as it was", () => {
    const clip = clipOf(readBvh(ownBvh(), "own.bvh"), skeleton);
    expect([clip.frames, Math.round(clip.rate)]).toEqual([4, 20]);
    const wanted = moment(2, 0, 0.15);
    const found = bodyAt(clip, 0.1);
    for (let k = 0; k < 4 * 22; k++) {
      const joint = 4 * (k >> 2);
      const sign = Math.sign(
        wanted.body.rotation.subarray(joint, joint + 4).reduce((sum, v, i) => sum + v * found.rotation[joint + i], 0),
      );
      expect(sign * found.rotation[k]).toBeCloseTo(wanted.body.rotation[k], 2);
    }
  });

  it.each([
    [
      "of a dog",
      DOG,
      /^x\.bvh is no person that this page knows: none of its 2 joints \(Hips, Tail …\) is a head;[^\n]*$/,
    ],
    ["of a dog with a person's names", namedDog(), /^x\.bvh goes on four legs: it may be an animal;[^\n]*$/],
    ["that was cut", ownBvh().slice(0, -900), /^x\.bvh (was cut short|: frame)[^\n]*$|^x\.bvh: frame[^\n]*$/],
    ["that is none", "hello", /^x\.bvh is no BVH file[^\n]*$/],
  ])("%s is refused in one line", (_, text, reason) => {
    expect(() => clipOf(readBvh(text, "x.bvh"), skeleton)).toThrow(reason);
  });
});

describe("joints of a rig", () => {
  it.each([
    ["Mixamo", (side: string, part: string) => `mixamorig:${side}${part}`],
    ["CMU", (side: string, part: string) => `${side}${part}`],
    ["an underscore", (side: string, part: string) => `${part}_${side === "Left" ? "L" : "R"}`],
  ])("are known by %s's names", (_, name) => {
    const parts = ["Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase"];
    const ours = ["collar", "shoulder", "elbow", "wrist", "hip", "knee", "ankle", "foot"];
    const names = [
      "Hips",
      "Spine",
      "Spine1",
      "Neck",
      "Head",
      ...["Left", "Right"].flatMap((side) => parts.map((part) => name(side, part))),
    ];
    const found = jointsOf(names);
    ["left", "right"].forEach((side, k) =>
      ours.forEach((part, row) => expect(found.get(`${side}_${part}`), `${side} ${part}`).toBe(5 + 8 * k + row)),
    );
    expect([found.get("pelvis"), found.get("head")]).toEqual([0, 4]);
  });

  it("are known by our own names", () => {
    const found = jointsOf(skeleton.points.slice(0, skeleton.joints));
    const wrong = [...found].filter(([name, row]) => skeleton.points[row] !== name);
    expect(wrong).toEqual([]);
    expect(found.size).toBe(52);
  });
});

describe("a recording", () => {
  const lines = [
    '{"format": "bodysense recording 1", "points": ["head"], "accuracy": {"head": 0.002}}',
    '{"time": 0.0, "position": {"head": [0, 1.6, 0]}, "rotation": {"head": [1, 0, 0, 0]}}',
    '{"time": 0.03, "position": {"head": [0, 1.6, 0]}}',
  ];

  it("is read as it was written", () => {
    const frames = recordingOfLines(lines.join("\n"));
    expect(frames.map(({ time }) => time)).toEqual([0, 0.03]);
    expect(frames[0].points).toEqual([
      { name: "head", position: [0, 1.6, 0], rotation: [1, 0, 0, 0], accuracy: 0.002 },
    ]);
  });

  it.each([
    ["with another header", ["{}", ...lines.slice(1)], "no header"],
    ["that was cut", [...lines, '{"time": 0.06, "pos'], "its line 4 cannot be read"],
    ["whose time stands", [...lines, lines[2]], "time does not increase at frame 2"],
    ["with a crooked position", [lines[0], lines[1], '{"time": 1, "position": {"head": [1]}}'], "has no 3 numbers"],
  ])("%s is refused", (_, rows, reason) => {
    expect(() => recordingOfLines(rows.join("\n"))).toThrow(reason);
  });
});

describe("anything else that is dropped", () => {
  it.each([
    ["film.mp4", "pictures", /^film\.mp4 is a film: complete it with `bodysense track film\.mp4 -o body\.bvh`[^\n]*$/],
    ["song.mp3", "la la la", /^song\.mp3 is nothing that this page reads; drop a motion[^\n]*$/],
    ["cut.npz", Uint8Array.from([0x50, 0x4b, 3, 4, 0, 0]), /^cut\.npz cannot be used: it is no \.npz archive[^\n]*$/],
    [
      "broken.vrm",
      new Uint8Array(new TextEncoder().encode("glTF....")),
      /^broken\.vrm is damaged: [^\n]*; export it again\.$/,
    ],
  ])("%s is refused in one line", async (name, content, reason) => {
    await expect(openFile(file(name, content), skeleton)).rejects.toThrow(reason);
  });

  it("is refused before it is read where it is too large", async () => {
    const unread = () => Promise.reject(new Error("was read"));
    const large = { name: "b.vrm", size: 2e9, arrayBuffer: unread, text: unread };
    await expect(openFile(large, skeleton)).rejects.toThrow("b.vrm has 2000 MB; this page takes 200 MB");
  });
});
