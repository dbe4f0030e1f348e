/** The stream of a webcam: how it is asked for, why it is refused, and how it comes back after it was unplugged. */

const WANTED: MediaStreamConstraints = { video: { width: 640, height: 480, facingMode: "user" } };
const REFUSALS: Readonly<Record<string, string>> = {
  NotAllowedError:
    "The webcam was refused: allow it for this page in the browser's address bar, and press Webcam again.",
  NotFoundError: "No webcam is connected: plug one in, and press Webcam again.",
  NotReadableError: "The webcam is used by another program: close that one, and press Webcam again.",
};

const DARK = 16; // of 255, largest brightness of all but 1 % of the pixels behind a covered lens
const EVERY = 16; // pixels of which one is looked at

/** Open the stream. Throws an Error of one line that names the missing part. */
export async function openStream(devices: Pick<MediaDevices, "getUserMedia">): Promise<MediaStream> {
  return devices.getUserMedia(WANTED).catch((error: unknown) => {
    const name = error instanceof DOMException ? error.name : "";
    throw new Error(
      REFUSALS[name] ?? `The webcam does not answer (${name || String(error)}): plug it in again, and press Webcam.`,
    );
  });
}

/** Call `back` once with a new stream, as soon as a webcam is connected. Return a function that waits no longer. */
export function whenBack(
  devices: Pick<MediaDevices, "getUserMedia" | "addEventListener" | "removeEventListener">,
  back: (stream: MediaStream) => void,
): () => void {
  let isWaiting = true;
  const giveUp = (): void => {
    isWaiting = false;
    devices.removeEventListener("devicechange", attempt);
  };
  function attempt(): void {
    void devices.getUserMedia(WANTED).then(
      (stream) => {
        if (!isWaiting) {
          for (const track of stream.getTracks()) track.stop();
          return;
        }
        giveUp();
        back(stream);
      },
      () => undefined, // another device has changed
    );
  }
  devices.addEventListener("devicechange", attempt);
  return giveUp;
}

/** Whether a picture (RGBA) is black but for noise: the lens is covered, or the room is dark. */
export function isDark(pixels: Uint8ClampedArray): boolean {
  let [bright, all] = [0, 0];
  for (let at = 0; at < pixels.length; at += 4 * EVERY, all++)
    if (Math.max(pixels[at], pixels[at + 1], pixels[at + 2]) >= DARK) bright++;
  return bright <= all / 100;
}
