/** A webcam's stream: refusals, an unplugged webcam that comes back, and a covered lens. */

import { expect, it, vi } from "vitest";
import { isDark, openStream, whenBack } from "../../src/sources/webcam/stream";

/** Devices of a browser; `plugged` says whether a webcam is there. */
class Devices extends EventTarget {
  plugged = true;
  readonly stopped = vi.fn();

  async getUserMedia(): Promise<MediaStream> {
    if (!this.plugged) throw new DOMException("", "NotFoundError");
    return { getTracks: () => [{ stop: this.stopped }] } as unknown as MediaStream;
  }

  /** A device comes or goes. */
  async change(plugged: boolean): Promise<void> {
    this.plugged = plugged;
    this.dispatchEvent(new Event("devicechange"));
    await new Promise((done) => setTimeout(done, 0));
  }
}

it("names the missing part", async () => {
  const devices = new Devices();
  devices.plugged = false;
  await expect(openStream(devices)).rejects.toThrow("No webcam is connected: plug one in, and press Webcam again.");
});

it("goes on once with a webcam that comes back, whatever else is plugged in before", async () => {
  const devices = new Devices();
  const back = vi.fn();
  whenBack(devices, back);
  await devices.change(false); // a headphone
  expect(back).not.toHaveBeenCalled();
  await devices.change(true);
  await devices.change(true);
  expect(back).toHaveBeenCalledTimes(1);
});

it("switches a webcam off that comes back after nobody waits", async () => {
  const devices = new Devices();
  const back = vi.fn();
  const giveUp = whenBack(devices, back);
  const opened = devices.change(true);
  giveUp();
  await opened;
  expect(back).not.toHaveBeenCalled();
  expect(devices.stopped).toHaveBeenCalledTimes(1);
});

it("holds a picture for black with a sensor's noise, not with a face by the light of a screen", () => {
  const picture = new Uint8ClampedArray(4 * 320 * 240);
  for (let at = 0; at < picture.length; at += 4) picture.fill((at * 7919) % 9, at, at + 3);
  expect(isDark(picture)).toBe(true);
  for (let y = 80; y < 140; y++) picture.fill(45, 4 * (320 * y + 100), 4 * (320 * y + 150));
  expect(isDark(picture)).toBe(false);
});
