/** A page whose address names a motion, an avatar and a transparent background, in a wide and in a tall window, and its
 * settings by keyboard:
 * node linked.mjs FOLDER MOTION.bvh PICTURE
 */

import { readFileSync } from "node:fs";
import { gunzipSync } from "node:zlib";
import { launched, scenario, serveFolder } from "../page.mjs";

const [folder, motion, picture] = process.argv.slice(2);
const site = await serveFolder(folder);
const until = (page, id, part) =>
  page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
    polling: 100,
  });

const options = { viewport: { width: 844, height: 390 }, serviceWorkers: "block" };
const missing = await launched([], options, async (page) => {
  await page.goto(`${site.address}?motion=nowhere.bvh`); // which the console complains of, too
  await until(page, "#notice-text", "nowhere.bvh");
  await until(page, "#source", "performance");
  await page.screenshot({ path: picture.replace(".png", "-landscape.png") });
  const focused = () => page.evaluate(() => document.activeElement.id);
  await page.focus("#settings");
  await page.keyboard.press("Enter");
  const keys = [await page.isVisible("#panel"), await focused()];
  await page.keyboard.press("Escape");
  keys.push(await page.isVisible("#panel"), await focused());
  const slider = await page.getAttribute("#scrub", "aria-valuetext");
  return { notice: await page.textContent("#notice-text"), keys, slider };
});
const motionOf = (page) => page.route("**/walk.bvh", (route) => route.fulfill({ body: readFileSync(motion) }));
await launched([], { ...options, viewport: { width: 390, height: 844 } }, async (page) => {
  await motionOf(page);
  await page.goto(`${site.address}?motion=walk.bvh&background=transparent`);
  await until(page, "#summary", "from the truth");
  await page.screenshot({ path: picture.replace(".png", "-tall.png"), omitBackground: true });
});
await scenario(options, async (page) => {
  await motionOf(page);
  await page.route("**/other.vrm", (route) =>
    route.fulfill({ body: gunzipSync(readFileSync(`${folder}/avatar.vrm.gz`)) }),
  );
  await page.goto(`${site.address}?motion=walk.bvh&avatar=other.vrm&background=transparent`);
  await until(page, "#source", "walk.bvh");
  await until(page, "#summary", "from the truth");
  const avatar = await page.inputValue("#avatar");
  await page.screenshot({ path: picture, omitBackground: true });
  return { missing, avatar, isBare: await page.isHidden("#intro") };
}).finally(() => site.close());
