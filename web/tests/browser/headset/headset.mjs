/** A wearer of an emulated headset on the page alone: node headset.mjs FOLDER PICTURES
 *
 * iwer stands for the headset: first with two controllers, then with two hands. Both press the menu in VR.
 */

import { pressMenu, putOn, wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [LOOK, RECORD] = [6, 7]; // rows of the menu
const YAW = 1; // rad, of the wearer
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
  await says("#rate", "completed here");
  await page.dispatchEvent("#settings", "click");
  await page.dispatchEvent("#calibrate", "click"); // before VR: it is not forgotten
  const before = await text("#notice-text");
  await putOn(page);
  await says("#notice-text", "measured.");
  const controllers = { summary: await text("#summary"), notice: await text("#notice-text") };
  await page.screenshot({ path: `${pictures}/vr.png` });
  await pressMenu(page, LOOK, { yaw: YAW });
  await page.waitForFunction(() => document.querySelector("input[name=figure][value=figure]").checked, null, {
    polling: 100,
  });
  await page.evaluate(() => {
    device.primaryInputMode = "hand";
    device.hands.left.position.set(-0.2, 1.45, -0.35);
    device.hands.right.position.set(0.2, 1.45, -0.35);
  });
  await says("#summary", "43 points"); // the head, two wrists and 20 joints a hand
  await pressMenu(page, RECORD, { kind: "hands", yaw: YAW });
  await says("#record", "Stop");
  await page.evaluate(() => headsetFrames(15));
  const hands = { summary: await text("#summary") };
  await page.evaluate(() => device.activeSession?.end()); // the headset goes away in the middle of a take
  await says("#notice-text", "kept");
  const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
  await download.saveAs(`${pictures}/take.bvh`);
  await page.waitForTimeout(1000);
  await page.screenshot({ path: `${pictures}/after.png` });
  const [after, take] = [await text("#notice-text"), await text("#take")];
  // Passthrough: the wearer's own room is behind the mirror.
  const isOffered = await page.isVisible("#open-room");
  await putOn(page, "#open-room");
  const room = { isOffered, blend: await page.evaluate(() => device.activeSession.environmentBlendMode) };
  await page.evaluate(() => void device.activeSession.end());
  await says("#notice-text", "is off");
  await page.evaluate(() => {
    navigator.xr.requestSession = () => Promise.reject(new DOMException("not now", "NotAllowedError"));
  });
  await page.dispatchEvent("#open-headset", "click");
  await says("#notice-text", "did not let");
  const refused = { refused: await text("#notice-text"), stillThere: await text("#take") };
  return { before, controllers, hands, after, take, room, ...refused };
});
site.close();
