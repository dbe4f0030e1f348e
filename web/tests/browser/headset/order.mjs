/** A headset that is worn three times, in another order and with other inputs each time: node order.mjs FOLDER PICTURES
 *
 * What the wearer sees in VR is in the pictures, and the texts of the menu are read as they are drawn.
 */

import { pressMenu, putOn, takeOff, wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [LEAVE, MIRROR] = [8, 5]; // rows of the menu
const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario({ colorScheme: "light", viewport: { width: 480, height: 320 } }, async (page) => {
  await wearEmulated(page);
  await page.addInitScript(readMenu);
  await page.goto(site.address);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const menu = async () => {
    await page.evaluate(() => headsetFrames(6));
    return page.evaluate(() => menuTexts[1]); // below the title
  };
  const isSilent = () => page.isHidden("#notice");
  /** The middle of what the wearer sees when they look down at their hands, held up before them. */
  const lookDown = async (kind, name) => {
    await page.evaluate((inputs) => {
      const half = -0.45; // rad, a quarter of a right angle down
      device.position.set(0, 1.6, 0);
      device.quaternion.set(Math.sin(half / 2), 0, 0, Math.cos(half / 2));
      device[inputs].left.position.set(-0.14, 1.35, -0.42);
      device[inputs].right.position.set(0.14, 1.35, -0.42);
      for (const side of ["left", "right"]) device[inputs][side].quaternion.set(0, 0, 0, 1);
    }, kind);
    await page.evaluate(() => headsetFrames(12));
    await page.screenshot({ path: `${pictures}/${name}.png` });
  };
  const facts = { menus: [], silent: [] };
  await says("#rate", "completed here");
  await page.dispatchEvent("#settings", "click");
  await page.dispatchEvent("#calibrate", "click");
  facts.nothingOn = await page.textContent("#notice-text");
  await page.reload(); // what is asked before a headset is on would be done in it
  await says("#rate", "completed here");

  // First in the room, with controllers, and left by the menu.
  await page.evaluate(() => device.quaternion.set(0, 0, 0, 1));
  await putOn(page, "#open-room");
  facts.menus.push(await menu());
  await lookDown("controllers", "controllers");
  await page.evaluate(() => device.quaternion.set(0, 0, 0, 1));
  await page.keyboard.press("c");
  await page.evaluate(() => headsetFrames(4));
  void pressMenu(page, LEAVE).catch(() => undefined); // its frames end with the session
  await says("#notice-text", "You are back");
  await page.evaluate(() => device.controllers.right.updateButtonValue("trigger", 0)); // released after the session

  // Then in VR with hands, and taken off while it measures.
  await page.evaluate(() => (device.primaryInputMode = "hand"));
  await page.dispatchEvent("#open-headset", "click");
  await says("#summary", "43 points");
  facts.menus.push(await menu());
  facts.silent.push(await isSilent());
  await lookDown("hands", "hands");
  await page.dispatchEvent("#calibrate", "click");
  await says("#notice-text", "out to the sides:");
  await takeOff(page);
  await says("#notice-text", "is off");

  // Another source, and the headset again: nothing is left of what was said or begun.
  await page.dispatchEvent("#open-performance", "click");
  await says("#source", "performance");
  await page.evaluate(() => {
    device.primaryInputMode = "controller";
    device.position.set(0, 1.6, 0);
    device.quaternion.set(0, 0, 0, 1);
  });
  await putOn(page);
  facts.menus.push(await menu());
  await page.evaluate(() => headsetFrames(20));
  facts.silent.push(await isSilent());
  await pressMenu(page, MIRROR);
  await page.evaluate(() => headsetFrames(4));
  await page.screenshot({ path: `${pictures}/no_mirror.png` });
  await pressMenu(page, MIRROR);

  // Who sits down is mirrored on a box.
  for (let k = 0; k <= 20; k++) {
    await page.evaluate((share) => {
      device.position.set(0, 1.6 - 0.42 * share, 0.12 * share);
      for (const [side, x] of [
        ["left", -0.2],
        ["right", 0.2],
      ])
        device.controllers[side].position.set(x, 1.0 - 0.25 * share, -0.1 - 0.25 * share);
    }, k / 20);
    await page.evaluate(() => headsetFrames(2));
  }
  await page.evaluate(async () => {
    const began = performance.now();
    for (let k = 0; k < 5 || performance.now() - began < 5000; k++) await headsetFrames(10);
  });
  await page.screenshot({ path: `${pictures}/seated.png` });
  await takeOff(page);
  return facts;
}).finally(() => site.close());

/** Keep the texts that the menu drew last in `menuTexts`: its first one is the title. */
function readMenu() {
  window.menuTexts = [];
  const { fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.fillText = function (text, ...where) {
    if (text === "bodysense") window.menuTexts = [];
    window.menuTexts.push(text);
    return fillText.call(this, text, ...where);
  };
}
