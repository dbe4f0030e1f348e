/** A webcam on the page alone, fed from a film, and one that shows nobody: node webcam.mjs FOLDER FILM PICTURE */

import { writeFile } from "node:fs/promises";
import { launched, scenario, serveFolder } from "./page.mjs";

const [folder, film, picture] = process.argv.slice(2);
const site = await serveFolder(folder);
const FAKE = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"];
const options = { viewport: { width: 420, height: 320 } };

/** Fewer pictures still: MediaPipe draws by the same processor. */
const slow = (page) =>
  page.addInitScript(() => {
    window.drawn = 0; // pictures
    const drawn = (call) => {
      call(performance.now());
      window.drawn++;
    };
    window.requestAnimationFrame = (call) => setTimeout(drawn, 700, call);
  });
const until = (page, id, part) =>
  page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
    polling: 100,
  });

const nobody = await launched(FAKE, options, async (page) => {
  await slow(page);
  await page.goto(site.address);
  await page.dispatchEvent("#open-webcam", "click"); // at once: what is pressed before the page is ready is not lost
  await until(page, "#notice-text", "Nobody");
  return page.textContent("#notice-text");
});
await scenario(
  options,
  async (page) => {
    await slow(page);
    await page.goto(site.address);
    await until(page, "#source", "performance");
    await page.evaluate(() => {
      window.notices = [];
      const line = document.getElementById("camera-says");
      new MutationObserver(() => notices.push(line.textContent)).observe(line, { childList: true });
      window.most = 0; // points: 20 more for each hand that is found
      const summary = document.getElementById("summary");
      new MutationObserver(() => {
        if (document.getElementById("source").textContent.includes("webcam"))
          most = Math.max(most, Number(/(\d+) points/.exec(summary.textContent)?.[1] ?? 0));
      }).observe(summary, { childList: true, characterData: true, subtree: true });
    });
    for (let press = 0; press < 2; press++) await page.dispatchEvent("#open-webcam", "click"); // twice, as people do
    await until(page, "#source", "webcam");
    // The performance has 3 points: from 8 on they are the webcam's.
    const seen = await page.waitForFunction(
      () => {
        const summary = document.getElementById("summary").textContent;
        return Number(/(\d+) points/.exec(summary)?.[1]) >= 8 && summary;
      },
      null,
      { polling: 100 },
    );
    const summary = await seen.jsonValue();
    const [, points] = /(\d+) points/.exec(summary);
    const notice = await page.textContent("#notice-text");
    await page.dispatchEvent("#record", "click");
    await page.waitForFunction(() => window.most >= 36, null, { polling: 100 }); // 16 of the body, 20 of a hand
    await page.waitForTimeout(3000);
    await page.dispatchEvent("#record", "click");
    await until(page, "#camera-says", "You are seen");
    await page.screenshot({ path: picture });
    const small = await page.evaluate(() => {
      const canvas = document.getElementById("camera-picture");
      const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
      return { notices, most, isShown: canvas.checkVisibility(), colours: new Set(new Uint32Array(data.buffer)).size };
    });
    const mirror = await mirrored(page);
    const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
    await download.saveAs(`${picture}.bvh`);
    await page.dispatchEvent("#open-performance", "click");
    await until(page, "#source", "performance");
    const isGone = await page.isHidden("#camera");
    return { nobody, points, summary, notice, small, mirror, isGone, rate: await page.textContent("#rate") };
  },
  [...FAKE, `--use-file-for-fake-video-capture=${film}`],
);
site.close();

/** The switch at the webcam's picture: what is kept; on which side of the body, which is paused, the raised hand is drawn
 * before and after; how far both pictures of the webcam are apart, as they are and with the later one flipped.
 */
async function mirrored(page) {
  await page.dispatchEvent("#play", "click"); // the body stands still
  const look = async (isMirrored) => {
    await page.waitForFunction(
      (pressed) => document.getElementById("camera-mirror").getAttribute("aria-pressed") === pressed,
      String(isMirrored),
      { polling: 100 },
    );
    const body = await stillBody(page);
    const small = await page.evaluate(() => document.getElementById("camera-picture").toDataURL());
    await writeFile(`${picture}.${isMirrored ? "mirrored" : "plain"}.png`, Buffer.from(body, "base64"));
    return { small, body: `data:image/png;base64,${body}` };
  };
  const states = () =>
    page.evaluate(() => [
      document.getElementById("camera-mirror").getAttribute("aria-pressed"),
      document.getElementById("mirrored").checked,
      JSON.parse(localStorage.getItem("bodysense.page") ?? "{}").mirroredWebcam ?? null,
    ]);
  const [first, before] = [await look(true), await states()];
  await page.dispatchEvent("#camera-mirror", "click");
  const [second, after] = [await look(false), await states()];
  return {
    states: [before, after],
    raised: [await page.evaluate(raisedSide, first.body), await page.evaluate(raisedSide, second.body)],
    picture: await page.evaluate(differences, [first.small, second.small]),
  };
}

/** A picture of the 3-D view alone, once its camera has stopped: two pictures in a row are equal. */
async function stillBody(page) {
  const view = await page.addStyleTag({ content: "body * { visibility: hidden } #view { visibility: visible }" });
  let [before, now] = ["", null];
  while (before !== now) {
    before = now;
    const after = (await page.evaluate(() => window.drawn)) + 2;
    await page.waitForFunction((count) => window.drawn >= count, after, { polling: 100 });
    now = (await page.screenshot()).toString("base64");
  }
  await view.evaluate((style) => style.remove());
  return now;
}

/** How far the upper fifth of a body reaches to the right of its middle and to the left, in pixels. */
async function raisedSide(address) {
  const image = await createImageBitmap(await (await fetch(address)).blob());
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, image.width, image.height);
  const body = []; // [x, y] of pixels that are darker than floor and paper
  for (let pixel = 0; pixel < data.length / 4; pixel++)
    if (data[4 * pixel + 1] < 180) body.push([pixel % image.width, Math.floor(pixel / image.width)]);
  const [top, bottom] = [body[0][1], body.at(-1)[1]];
  const [middle] = body.toSorted(([one], [other]) => one - other)[Math.floor(body.length / 2)];
  const upper = body.filter(([, y]) => y < top + (bottom - top) / 5).map(([x]) => x - middle);
  return [Math.max(...upper), -Math.min(...upper)];
}

/** Mean differences of two pictures: as they are, and with the second one flipped. */
async function differences([one, other]) {
  const pixels = async (address, isFlipped) => {
    const image = await createImageBitmap(await (await fetch(address)).blob());
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
    context.setTransform(isFlipped ? -1 : 1, 0, 0, 1, isFlipped ? image.width : 0, 0);
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  };
  const before = await pixels(one, false);
  const apart = (after) => before.reduce((sum, value, k) => sum + Math.abs(value - after[k]), 0) / before.length;
  return [apart(await pixels(other, false)), apart(await pixels(other, true))];
}
