/** A webcam whose pictures are those of a film, each at its own time by the page's clock, so that the truth of every frame
 * is known however slow the machine is: node webcam_film.mjs FOLDER PICTURES OUT.bvh
 *
 * PICTURES has 0.jpg, 1.jpg, …, RATE a second. The take begins with the first one.
 */

import { readdirSync, readFileSync } from "node:fs";
import { scenario, serveFolder } from "./page.mjs";

const RATE = 15; // Hz
const [folder, pictures, out] = process.argv.slice(2);
const site = await serveFolder(folder);
const FAKE = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"];
const film = readdirSync(pictures)
  .sort((one, other) => parseInt(one) - parseInt(other))
  .map((name) => `data:image/jpeg;base64,${readFileSync(`${pictures}/${name}`).toString("base64")}`);

await scenario(
  { viewport: { width: 420, height: 320 }, serviceWorkers: "block" },
  async (page) => {
    await page.addInitScript(playFilm, RATE);
    const until = (id, part) =>
      page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
        polling: 100,
      });
    await page.goto(site.address);
    await until("#source", "performance");
    await page.evaluate(async (addresses) => {
      const blobs = await Promise.all(addresses.map(async (address) => (await fetch(address)).blob()));
      window.film = await Promise.all(blobs.map((blob) => window.bitmapOf(blob)));
    }, film);
    await page.dispatchEvent("#open-webcam", "click");
    await until("#camera-says", "You are seen");
    await page.dispatchEvent("#record", "click");
    await page.evaluate(() => void (window.begun = performance.now()));
    const isOver = (length) => performance.now() >= window.begun + length;
    await page.waitForFunction(isOver, 1000 * (film.length / RATE), { polling: 20 });
    await page.dispatchEvent("#record", "click");
    const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
    await download.saveAs(out);
    return { summary: await page.textContent("#summary"), camera: await page.textContent("#camera-says") };
  },
  FAKE,
).finally(() => site.close());

/** The page's clock goes on by a picture when the landmarks of the one before were found. */
function playFilm(rate) {
  let now = performance.now();
  let isLooking = false;
  window.begun = Infinity; // the first picture until the take begins
  performance.now = () => now;
  window.bitmapOf = window.createImageBitmap.bind(window);
  window.createImageBitmap = (source) => {
    if (!window.film || !(source instanceof HTMLVideoElement)) return window.bitmapOf(source);
    isLooking = true;
    const frame = Math.max(Math.round(((now - window.begun) * rate) / 1000), 0);
    return window.bitmapOf(window.film[Math.min(frame, window.film.length - 1)]);
  };
  Object.defineProperty(HTMLMediaElement.prototype, "currentTime", { get: () => now / 1000 });
  window.Worker = class extends Worker {
    constructor(address, options) {
      super(address, options);
      if (options.name === "camera") this.addEventListener("message", () => (isLooking = false));
    }
  };
  window.requestAnimationFrame = (call) => {
    const next = () => (isLooking ? setTimeout(next, 5) : call((now += 1000 / rate)));
    return setTimeout(next, 5);
  };
}
