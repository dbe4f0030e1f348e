/** A headset that is worn, taken off and worn again, with other sources in between: node again.mjs FOLDER PICTURES */

import { putOn, takeOff, wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario({ colorScheme: "light", viewport: { width: 480, height: 320 } }, async (page) => {
  await wearEmulated(page);
  await page.goto(site.address);
  const text = (id) => page.textContent(id);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const enter = async () => {
    await putOn(page);
    await page.evaluate(() => headsetFrames(10));
    return page.evaluate(() => Boolean(device.activeSession));
  };
  await says("#rate", "completed here");
  const entries = [await enter()];
  await takeOff(page);
  entries.push(await enter()); // at once
  await page.screenshot({ path: `${pictures}/again.png` });
  await takeOff(page);
  await page.dispatchEvent("#open-performance", "click");
  await says("#source", "performance");
  const isOver = await page.isHidden("#notice"); // of the headset that was taken off
  entries.push(await enter()); // after another source
  await takeOff(page);
  return { entries, isOver, notice: await text("#notice-text") };
});
site.close();
