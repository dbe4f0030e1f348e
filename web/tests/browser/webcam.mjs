/** A webcam on the page alone, fed from a film, and one that shows nobody: node webcam.mjs FOLDER FILM PICTURE */

import { launched, scenario, serveFolder } from "./page.mjs";

const [folder, film, picture] = process.argv.slice(2);
const site = await serveFolder(folder);
const FAKE = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"];
const options = { viewport: { width: 420, height: 320 } };

/** Fewer pictures still: MediaPipe draws by the same processor. */
const slow = (page) =>
  page.addInitScript(() => {
    window.requestAnimationFrame = (call) => setTimeout(() => call(performance.now()), 700);
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
    await page.waitForTimeout(6000); // the film of 4 s, and more
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

/** The switch at the webcam's picture: how much picture and body change by it, how much without it, and what is kept. */
async function mirrored(page) {
  await page.dispatchEvent("#play", "click"); // the body stands still
  const look = async () => {
    await page.waitForTimeout(3000);
    const small = await page.evaluate(() => document.getElementById("camera-picture").toDataURL());
    await page.evaluate(() => (document.getElementById("camera").style.visibility = "hidden"));
    const body = (await page.screenshot()).toString("base64");
    await page.evaluate(() => (document.getElementById("camera").style.visibility = ""));
    return { small, body: `data:image/png;base64,${body}` };
  };
  const states = () =>
    page.evaluate(() => [
      document.getElementById("camera-mirror").getAttribute("aria-pressed"),
      document.getElementById("mirrored").checked,
      JSON.parse(localStorage.getItem("bodysense.page") ?? "{}").mirroredWebcam ?? null,
    ]);
  const [first, second, before] = [await look(), await look(), await states()];
  await page.dispatchEvent("#camera-mirror", "click");
  const [third, after] = [await look(), await states()];
  const apart = (one, other, isFlipped = false) => page.evaluate(difference, [one, other, isFlipped]);
  return {
    states: [before, after],
    body: [await apart(first.body, second.body), await apart(first.body, third.body)],
    picture: [await apart(first.small, third.small), await apart(first.small, third.small, true)],
  };
}

/** Mean difference of two pictures, the second one flipped or not. */
async function difference([one, other, isFlipped]) {
  const pixels = async (address, isTurned) => {
    const image = await createImageBitmap(await (await fetch(address)).blob());
    const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
    context.setTransform(isTurned ? -1 : 1, 0, 0, 1, isTurned ? image.width : 0, 0);
    context.drawImage(image, 0, 0);
    return context.getImageData(0, 0, image.width, image.height).data;
  };
  const [a, b] = [await pixels(one, false), await pixels(other, isFlipped)];
  return a.reduce((sum, value, k) => sum + Math.abs(value - b[k]), 0) / a.length;
}
