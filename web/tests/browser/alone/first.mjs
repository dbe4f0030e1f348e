/** Seconds of a first visit until pictures of a person move, and until one is drawn that the network completed, at full
 * speed: node first.mjs FOLDER PICTURE
 */

import { scenario, serveFolder } from "../page.mjs";

const [folder, picture] = process.argv.slice(2);
const site = await serveFolder(folder);
await scenario({ isCalm: false }, async (page) => {
  await page.addInitScript(waitUntilDrawn);
  await page.goto("about:blank");
  await page.evaluate(() => void document.createElement("canvas").getContext("webgl2")); // a browser that is in use
  await page.goto(site.address);
  const isMarked = () => performance.getEntriesByName("moving").length > 0;
  await page.waitForFunction(isMarked, null, { polling: 50 });
  await page.screenshot({ path: picture });
  const isCompleted = () => performance.getEntriesByName("completed").length > 0;
  await page.waitForFunction(isCompleted, null, { polling: 50 });
  return page.evaluate(() => {
    const [moving, completed, words] = ["moving", "completed", "first-contentful-paint"].map(
      (name) => performance.getEntriesByName(name)[0].startTime / 1000,
    );
    const firstByte = performance.getEntriesByType("navigation")[0].responseStart / 1000;
    const begun = performance.getEntriesByType("resource").filter(({ startTime }) => startTime < 1000 * moving);
    return { firstByte, words, moving, completed, before: begun.map(({ name }) => name.split("/").pop()) };
  });
});
site.close();

/** The page marks after it asked for pictures: read a pixel back, so that a mark is set when they are drawn. */
function waitUntilDrawn() {
  const contextOf = HTMLCanvasElement.prototype.getContext;
  let drawn = null;
  HTMLCanvasElement.prototype.getContext = function (...parameters) {
    const context = contextOf.apply(this, parameters);
    if (this.isConnected) drawn = context;
    return context;
  };
  const mark = performance.mark.bind(performance);
  performance.mark = (name) => {
    drawn?.readPixels(0, 0, 1, 1, drawn.RGBA, drawn.UNSIGNED_BYTE, new Uint8Array(4));
    return mark(name);
  };
}
