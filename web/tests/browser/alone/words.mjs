/** Every state of the page that a person comes through without a server, for its words: node words.mjs FOLDER PICTURES */

import { pressMenu, putOn, takeOff, wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const SITTING = 4; // row of the menu
const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario({ viewport: { width: 640, height: 420 } }, async (page) => {
  await wearEmulated(page);
  await page.goto(site.address);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 50,
    });
  const click = (what) => page.dispatchEvent(what, "click");
  await says("#rate", "completed here");
  await click("#settings");
  await click("input[name=figure][value=figure]");
  for (const colouring of ["confidence", "hidden", "error", "plain"]) {
    await page.selectOption("#colouring", colouring);
    if (colouring !== "plain") await page.waitForSelector("#legend:not([hidden])");
  }
  for (const set of ["head", "feet", "hands"]) {
    await page.selectOption("#set", set);
    await page.waitForTimeout(400);
  }
  await click("#settings");
  await click("#takes");
  for (const text of ["Stop", "Record a take"]) {
    await click("#record");
    await says("#record", text);
    await page.waitForTimeout(1000);
  }
  await click("#take-list button");
  await says("#summary", "Recorded before");
  await click("#play");
  await page.screenshot({ path: `${pictures}/take.png` });
  await click("#takes");

  await putOn(page);
  await click("#calibrate");
  await says("#notice-text", "Hold still");
  await pressMenu(page, SITTING, { yaw: 1 });
  await click("#calibrate");
  await says("#notice-text", "sitting");
  await page.evaluate(() => (device.controllers.left.connected = device.controllers.right.connected = false));
  await says("#summary", "1 point ");
  await takeOff(page);

  await click("#settings");
  await page.fill("#bridge", "not an address");
  await click("#bridge-send");
  await says("#notice-text", "no address");
  await page.setInputFiles("#file", { name: "song.ogg", mimeType: "audio/mpeg", buffer: Buffer.alloc(100) });
  await says("#notice-text", "song.ogg");
  return {};
}).finally(() => site.close());
