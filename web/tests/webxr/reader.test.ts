/** Tracked points read from a headset's frame. */

import { HeadsetReader } from "@bodysense/core/webxr";
import { readFileSync } from "node:fs";
import { describe, expect, it } from "vitest";
import { rotate } from "../../src/body/math";
import { skeleton } from "../body";

const FINGERS = ["index", "middle", "ring", "pinky"];
const HAND = [
  "wrist",
  ...["metacarpal", "phalanx-proximal", "phalanx-distal", "tip"].map((segment) => `thumb-${segment}`),
  ...FINGERS.flatMap((finger) =>
    ["metacarpal", "phalanx-proximal", "phalanx-intermediate", "phalanx-distal", "tip"].map(
      (segment) => `${finger}-finger-${segment}`,
    ),
  ),
];
const { landmarks } = JSON.parse(
  readFileSync(new URL("../../../src/bodysense/body/default_body.json", import.meta.url), "utf8"),
) as { landmarks: { name: string; offset: [number, number, number] }[] };
const transform = { position: { x: 1, y: 2, z: 3 }, orientation: { x: 0, y: 0, z: 0, w: 1 } };
const pose = (emulatedPosition = false) => ({ transform, emulatedPosition }) as unknown as XRViewerPose;
const space = {} as XRReferenceSpace;
const source = (part: object, handedness = "left") => ({ handedness, ...part }) as unknown as XRInputSource;
const hand = (names = HAND) => new Map(names.map((jointName) => [jointName, { jointName }]));
const frame = (viewer: XRViewerPose | null, tracked: (jointName?: string) => XRPose | null) =>
  ({
    getViewerPose: () => viewer,
    getPose: () => tracked(),
    getJointPose: ({ jointName }: { jointName: string }) => tracked(jointName),
  }) as unknown as XRFrame;

describe("a headset's points", () => {
  it("have the head behind the eyes, facing where the headset looks", () => {
    const [head] = new HeadsetReader().read(
      frame(pose(), () => pose()),
      space,
      [],
    ); // looks along −Z
    expect(head?.name).toBe("head");
    expect(rotate(head?.rotation ?? [1, 0, 0, 0], [0, 0, 1]).map((v) => Math.round(v))).toEqual([0, 0, -1]);
    const away = head?.position?.map((v, k) => v - [1, 2, 3][k]!) ?? [];
    const [x, y, z] = landmarks.find(({ name }) => name === "between_eyes")!.offset;
    [x, -y, z].forEach((value, k) => expect(away[k]).toBeCloseTo(value, 9));
  });

  it("have the wrist of a held controller as far from it as the default body's palm", () => {
    for (const side of ["left", "right"]) {
      const [, wrist] = new HeadsetReader().read(
        frame(pose(), () => pose()),
        space,
        [source({ gripSpace: {} }, side)],
        2,
      );
      expect(wrist?.name).toBe(`${side}_wrist`);
      const palm = landmarks.find(({ name }) => name === `${side}_palm`)!.offset;
      const held = rotate(wrist?.rotation ?? [1, 0, 0, 0], palm); // from the wrist to the palm
      held.forEach((value, k) => expect((wrist?.position?.[k] ?? 0) + 2 * value).toBeCloseTo([1, 2, 3][k]!, 9));
    }
  });

  it("are named as the body's are, of 25 joints a hand all but the metacarpals of four fingers", () => {
    const both = [source({ hand: hand() }), source({ hand: hand() }, "right"), source({ hand: hand() }, "none")];
    const points = new HeadsetReader().read(
      frame(pose(), () => pose()),
      space,
      both,
    );
    expect(points.every(({ name }) => skeleton.points.includes(name))).toBe(true);
    expect(points.length).toBe(43);
    expect(points.find(({ name }) => name === "left_index1")).toEqual({
      name: "left_index1",
      position: [1, 2, 3],
      rotation: null,
      accuracy: 0.01,
    });
  });

  it("leave out what is not tracked, and a pointer that is no hand", () => {
    const points = new HeadsetReader().read(
      frame(null, (jointName) => (jointName === "wrist" ? pose() : null)),
      space,
      [source({ hand: hand() }), source({ gripSpace: {}, targetRayMode: "transient-pointer" }, "right")],
    );
    expect(points.map(({ name }) => name)).toEqual(["left_wrist"]);
  });

  it("leave out guesses of what was measured, and believe a device that only guesses", () => {
    const reader = new HeadsetReader();
    const counts = [true, false, true].map(
      (isGuess) =>
        reader.read(
          frame(null, () => pose(isGuess)),
          space,
          [source({ gripSpace: {} })],
        ).length,
    );
    expect(counts).toEqual([1, 1, 0]);
  });
});
