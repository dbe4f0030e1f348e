/** A webcam on the page alone, fed from a film, and one that shows nobody: node webcam.mjs FOLDER FILM PICTURES */

import { launched, scenario, serveFolder } from "./page.mjs";

const [folder, film, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);
const FAKE = ["--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"];
const options = { viewport: { width: 420, height: 320 } };

const until = (page, id, part) =>
  page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
    polling: 100,
  });

const nobody = await launched(FAKE, options, async (page) => {
  await page.goto(site.address);
  await page.dispatchEvent("#door-webcam", "click");
  await until(page, "#notice-text", "Nobody");
  return page.textContent("#notice-text");
});
await scenario(
  options,
  async (page) => {
    await page.goto(site.address);
    await page.dispatchEvent("#door-webcam", "click");
    await until(page, "#source", "webcam");
    await until(page, "#shown", "points");
    await page.waitForTimeout(8000);
    await page.screenshot({ path: `${pictures}/webcam.png` });
    const [, points] = /(\d+) points/.exec(await page.textContent("#shown"));
    return { nobody, points, shown: await page.textContent("#shown"), rate: await page.textContent("#rate") };
  },
  [...FAKE, `--use-file-for-fake-video-capture=${film}`],
);
site.close();
