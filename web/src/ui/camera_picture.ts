/** The webcam's picture, small next to the body, with the landmarks that were found and a line on its state. */

import { button, element, find } from "../page";
import { isDark } from "../sources/webcam/stream";

/** Landmarks in the picture, 0 … 1 from its top left corner, and how sure each is. */
export type Marks = readonly { readonly x: number; readonly y: number; readonly visibility?: number }[];

const WIDTH = 320; // pixels
const VISIBLE = 0.5; // probability from which a landmark is drawn
const FIRST = 11; // shoulders; before them are landmarks of the face
const BONES = "11-12 11-13 13-15 12-14 14-16 11-23 12-24 23-24 23-25 25-27 27-31 24-26 26-28 28-32"
  .split(" ")
  .map((pair) => pair.split("-").map(Number));
const HAND = "0-1 1-2 2-3 3-4 0-5 5-6 6-7 7-8 5-9 9-10 10-11 11-12 9-13 13-14 14-15 15-16 13-17 0-17 17-18 18-19 19-20"
  .split(" ")
  .map((pair) => pair.split("-").map(Number));
const COLOUR = "#35d0ba";

export class CameraPicture {
  private readonly frame = element("camera");
  private readonly canvas = find("camera-picture", HTMLCanvasElement);
  private readonly context = this.canvas.getContext("2d");

  /** `mirror` says whether pictures are drawn as a mirror shows them; `switched` is called to change that. */
  constructor(
    private readonly mirror: () => boolean,
    switched: () => void,
  ) {
    button("camera-mirror").onclick = switched;
  }

  /** Whether the last picture is black but for noise. */
  get isDark(): boolean {
    const { width, height } = this.canvas;
    return this.context !== null && isDark(this.context.getImageData(0, 0, width, height).data);
  }

  /** Draw a picture with the landmarks that were found in it. */
  draw(
    picture: HTMLVideoElement | ImageBitmap,
    marks: Marks = [],
    hands: readonly { readonly picture: Marks }[] = [],
  ): void {
    const isVideo = picture instanceof HTMLVideoElement;
    const [across, up] = isVideo ? [picture.videoWidth, picture.videoHeight] : [picture.width, picture.height];
    if (!this.context || across === 0) return;
    const height = Math.round((WIDTH * up) / across);
    if (this.canvas.height !== height) [this.canvas.width, this.canvas.height] = [WIDTH, height];
    const { context } = this;
    const isMirrored = this.mirror();
    button("camera-mirror").setAttribute("aria-pressed", String(isMirrored));
    context.setTransform(isMirrored ? -1 : 1, 0, 0, 1, isMirrored ? WIDTH : 0, 0);
    context.drawImage(picture, 0, 0, WIDTH, height);
    context.strokeStyle = context.fillStyle = COLOUR;
    context.lineWidth = 3;
    const isSeen = (mark: number): boolean => (marks[mark]?.visibility ?? 0) >= VISIBLE;
    const place = (mark: number): [number, number] => [marks[mark].x * WIDTH, marks[mark].y * height];
    context.beginPath();
    for (const [start, end] of BONES)
      if (isSeen(start) && isSeen(end)) {
        context.moveTo(...place(start));
        context.lineTo(...place(end));
      }
    for (const { picture: hand } of hands)
      for (const [start, end] of HAND) {
        context.moveTo(hand[start].x * WIDTH, hand[start].y * height);
        context.lineTo(hand[end].x * WIDTH, hand[end].y * height);
      }
    context.stroke();
    for (let mark = 0; mark < marks.length; mark++)
      if (isSeen(mark) && (mark === 0 || mark >= FIRST)) {
        context.beginPath();
        context.arc(...place(mark), 4, 0, 2 * Math.PI);
        context.fill();
      }
  }

  /** Show the picture's frame with one line below. */
  say(text: string): void {
    this.frame.hidden = false;
    const line = element("camera-says");
    if (line.textContent !== text) line.textContent = text; // screen readers read a line aloud each time it is set
  }

  hide(): void {
    this.frame.hidden = true;
    this.context?.clearRect(0, 0, this.canvas.width, this.canvas.height);
  }
}
