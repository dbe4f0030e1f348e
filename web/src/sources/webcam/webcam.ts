/** A webcam: a person's landmarks, found in a worker, become points of the body. Nothing leaves this browser. */

import { VISIBLE } from "./constants";
import { handsOf, smoothedHands, type Hand } from "./hands";
import { mark, SIDES, type Landmarks } from "./landmark_marks";
import { LandmarkPoints } from "./landmarks";
import { mixed, type Vector } from "../../body/math";
import type { FromCamera, ToCamera } from "../../engine/camera_worker";
import type { Live } from "../../live";
import type { CameraPicture } from "../../ui/camera_picture";
import { Presence } from "./presence";
import type { Source } from "../source";
import { openStream, whenBack } from "./stream";

const FIELD_OF_VIEW = 60; // degrees over the longer side of the picture, as webcams usually have it
const CALM = 0.05; // s: half-life of the smoothing of landmarks
const GUESSED = 0.15; // largest probability of landmarks beyond the picture; the library's have it, too
const LONELY = 4; // s without a person before the page reports it
const BLACK = "The webcam's picture is black: uncover its lens, or switch a light on.";
const NOBODY = "Nobody is seen yet: step back until the picture holds you from head to hips, better to the feet.";
const LOADING = "Loading the person detector: 31 MB, once …";
const LOOKING = "Looking for you …";
/** Open the webcam. Throws an Error of one line that names the missing part. */
export async function openWebcam(
  base: string,
  live: Live,
  small: CameraPicture,
  say: (text: string | null) => void,
): Promise<Source> {
  if (!navigator.mediaDevices)
    throw new Error("A webcam needs a safe address: open this page by https, or at http://localhost.");
  small.say("The browser asks for the webcam …");
  const stream = await openStream(navigator.mediaDevices).catch((error: unknown) => {
    small.hide();
    throw error;
  });
  const video = document.createElement("video");
  video.srcObject = stream;
  video.muted = video.playsInline = true;
  await video.play();
  return new Webcam(stream, video, small, base, live, say);
}

class Webcam implements Source {
  readonly isYou = true;
  readonly isWebcam = true;
  readonly guide =
    "Stand back until the picture holds you from head to hips, better to the feet. It stays in this browser.";
  sensors: readonly string[] = [];
  private readonly worker = new Worker(new URL("../../engine/camera_worker.ts", import.meta.url), {
    type: "module",
    name: "camera",
  });
  private readonly points: LandmarkPoints;
  private calm: Landmarks | null = null;
  private readonly presence = new Presence();
  private isOpen = false;
  private isLooking = false;
  private lastTime = -1; // s, of the video: time of the last analysed picture
  private before = 0; // ms, of the frame with a person before
  private lonely = performance.now(); // ms: when a person was last seen
  private reported: string | null = null; // why no person is seen
  private pictures = 0;
  private withYou = 0; // of these pictures
  private giveUp: () => void = () => undefined; // wait no longer for a webcam that was unplugged

  constructor(
    private stream: MediaStream,
    private readonly video: HTMLVideoElement,
    private readonly small: CameraPicture,
    base: string,
    private readonly live: Live,
    private readonly say: (text: string | null) => void, // null: what was said is over
  ) {
    const aspect = video.videoWidth / Math.max(video.videoHeight, 1);
    this.points = new LandmarkPoints(Math.max(aspect, 1) / 2 / Math.tan((FIELD_OF_VIEW * Math.PI) / 360));
    this.worker.onmessage = ({ data }: MessageEvent<FromCamera>) => this.hear(data);
    this.worker.onerror = () => say("This browser cannot run MediaPipe; use a newer one.");
    this.worker.postMessage({ type: "open", base } satisfies ToCamera);
    small.say(LOADING);
    this.guard();
  }

  /** Wait for the webcam if it is unplugged, and continue once it is back. */
  private guard(): void {
    for (const track of this.stream.getTracks())
      track.onended = () => {
        this.say("The webcam was unplugged: plug it in again, and it goes on. What the timeline holds is kept.");
        this.small.say("The webcam is unplugged");
        this.giveUp = whenBack(navigator.mediaDevices, (stream) => {
          this.stream = this.video.srcObject = stream;
          this.lonely = performance.now();
          this.reported = null;
          void this.video.play();
          this.guard();
          this.small.say(LOOKING);
          this.say(null);
        });
      };
  }

  get title(): string {
    if (this.presence.isThere) return "You, by webcam";
    return `You, by webcam: ${this.isOpen ? "nobody is seen" : "loading"}`;
  }

  get isAbsent(): boolean {
    return !this.presence.isThere;
  }

  frame(milliseconds: number): void {
    if (!this.isOpen) this.small.draw(this.video); // later pictures are drawn with their landmarks
    if (!this.isOpen || this.isLooking || this.video.currentTime === this.lastTime) return;
    this.lastTime = this.video.currentTime;
    this.isLooking = true;
    void createImageBitmap(this.video).then(
      (picture) => this.worker.postMessage({ type: "look", picture, milliseconds } satisfies ToCamera, [picture]),
      () => (this.isLooking = false), // the video has no picture yet
    );
  }

  stop(): void {
    this.giveUp();
    this.small.hide();
    for (const track of this.stream.getTracks()) {
      track.onended = null;
      track.stop();
    }
    this.worker.terminate();
  }

  private hear(message: FromCamera): void {
    if (message.type === "opened") {
      this.isOpen = true;
      this.small.say(LOOKING);
      this.lonely = performance.now();
    } else if (message.type === "failed")
      this.say(`MediaPipe stopped (${message.reason.split("\n")[0]}): press Webcam again.`);
    else this.see(message);
  }

  private see({ world, picture, hands, image, milliseconds }: Extract<FromCamera, { type: "seen" }>): void {
    this.isLooking = false;
    this.small.draw(image, picture, hands);
    image.close();
    const aspect = this.video.videoWidth / Math.max(this.video.videoHeight, 1);
    const placesOf = (marks: typeof world): Vector[] => marks.map(({ x, y, z }): Vector => [x, -y, -z]);
    const shares = (marks: typeof picture) => marks.map(({ x, y }) => [(x - 0.5) * aspect, 0.5 - y] as const);
    const body: Landmarks | null =
      world.length === 0
        ? null
        : {
            world: placesOf(world),
            picture: shares(picture),
            // A part beyond the picture is a guess, however visible MediaPipe holds it.
            visible: world.map(({ visibility }, k) =>
              Math.min(visibility ?? 0, picture[k].presence ?? 1, isInside(picture[k]) ? 1 : GUESSED),
            ),
          };
    const seen = hands.map((one): Hand => ({ ...one, world: placesOf(one.world), picture: shares(one.picture) }));
    const found = body && { ...body, hands: handsOf(body, seen) };
    const passed = Math.min((milliseconds - this.before) / 1000, 1);
    this.calm = found && this.calm ? smoothed(this.calm, found, 1 - 2 ** (-passed / CALM)) : found;
    const points =
      found && this.calm && this.points.read(found, this.calm, this.live.tree, passed, milliseconds / 1000);
    const wasThere = this.presence.isThere;
    this.pictures += 1;
    this.withYou += points ? 1 : 0;
    if (!this.presence.look(points !== null, milliseconds) && wasThere) {
      const share = Math.round((100 * this.withYou) / this.pictures);
      this.small.say(`Nobody is seen. You were in ${share} % of the pictures`);
    }
    if (!points) {
      if (milliseconds - this.lonely > 1000 * LONELY) this.report(this.small.isDark ? BLACK : NOBODY);
      return;
    }
    this.small.say(seenOf(found?.visible ?? []));
    this.before = this.lonely = milliseconds;
    this.report(null);
    this.sensors = points.map(({ name }) => name);
    this.live.track({ time: milliseconds / 1000, points }, null);
  }

  /** Say once why no person is seen; null: one is. */
  private report(reason: string | null): void {
    if (reason === this.reported) return;
    this.reported = reason;
    this.say(reason);
  }
}

function isInside({ x, y }: { readonly x: number; readonly y: number }): boolean {
  return Math.min(x, y) >= 0 && Math.max(x, y) <= 1;
}

/** How much of a person is seen. */
function seenOf(visible: readonly number[]): string {
  const ankles = SIDES.map((side) => visible[mark(side, "ankle")]);
  return Math.max(...ankles) >= VISIBLE ? "You are seen" : "You are seen, without your feet";
}

function smoothed(before: Landmarks, now: Landmarks, share: number): Landmarks {
  return {
    world: now.world.map((point, k) => mixed(before.world[k], point, share)),
    picture: now.picture.map(([x, y], k) => {
      const [a, b] = before.picture[k];
      return [a + share * (x - a), b + share * (y - b)] as const;
    }),
    visible: now.visible,
    hands: smoothedHands(before.hands ?? {}, now.hands ?? {}, share),
  };
}
