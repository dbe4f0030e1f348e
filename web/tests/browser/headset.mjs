/** A wearer of an emulated headset on the page alone: node headset.mjs FOLDER PICTURES
 *
 * iwer stands for the headset: first with two controllers, then with two hands. Both press the menu in VR.
 */

import { wearEmulated } from "./emulated_headset.mjs";
import { scenario, serveFolder } from "./page.mjs";

const [LOOK, RECORD] = [6, 7]; // rows of the menu
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
  await page.dispatchEvent("#door-headset", "click");
  await says("#source", "headset");
  await says("#shown", "3 points");
  await says("#notice-text", "measured.");
  const controllers = { shown: await text("#shown"), notice: await text("#notice-text") };
  await page.screenshot({ path: `${pictures}/vr.png` });
  await page.evaluate(press, ["controllers", LOOK]);
  await page.waitForFunction(() => document.querySelector("input[name=figure][value=figure]").checked, null, {
    polling: 100,
  });
  await page.evaluate(() => {
    device.primaryInputMode = "hand";
    device.hands.left.position.set(-0.2, 1.45, -0.35);
    device.hands.right.position.set(0.2, 1.45, -0.35);
  });
  await says("#shown", "43 points"); // the head, two wrists and 20 joints a hand
  await page.evaluate(press, ["hands", RECORD]);
  await says("#record", "Stop");
  await page.waitForTimeout(2000);
  const hands = { shown: await text("#shown") };
  await page.evaluate(() => device.activeSession?.end()); // the headset goes away in the middle of a take
  await says("#notice-text", "kept");
  const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
  await download.saveAs(`${pictures}/take.bvh`);
  await page.waitForTimeout(1000);
  await page.screenshot({ path: `${pictures}/after.png` });
  const [after, take] = [await text("#notice-text"), await text("#take")];
  await page.evaluate(() => {
    navigator.xr.requestSession = () => Promise.reject(new DOMException("not now", "NotAllowedError"));
  });
  await page.dispatchEvent("#door-headset", "click");
  await says("#notice-text", "did not let");
  const refused = { refused: await text("#notice-text"), stillThere: await text("#take") };
  return { before, controllers, hands, after, take, ...refused };
});
site.close();

/** Point at a row of the menu from half a metre and pull the trigger, or pinch: the menu stands to the right of the mirror. */
async function press([kind, row]) {
  const yaw = 1; // rad, of the wearer
  const turned = (angle, [x, y, z]) => [
    x * Math.cos(angle) + z * Math.sin(angle),
    y,
    z * Math.cos(angle) - x * Math.sin(angle),
  ];
  const sum = (...vectors) => [0, 1, 2].map((k) => vectors.reduce((total, vector) => total + vector[k], 0));
  const mirror = sum([device.position.x, 0, device.position.z], turned(yaw, [0, 0, -1.5]));
  const [height, above, step] = [0.935, 0.14, 0.087]; // m: of the board, over its rows, from row to row
  const down = [0, height / 2 - above - step * row - 0.04, 0];
  const place = sum(mirror, turned(yaw, [1.12, 1.3, 0.35]), down, turned(yaw - 0.6, [0, 0, 0.5]));
  const input = device[kind].right;
  input.position.set(...place);
  input.quaternion.set(0, Math.sin((yaw - 0.6) / 2), 0, Math.cos((yaw - 0.6) / 2));
  const frames = () => new Promise((done) => setTimeout(done, 700));
  const pull = (value) =>
    kind === "hands" ? input.updatePinchValue(value) : input.updateButtonValue("trigger", value);
  await frames();
  pull(1);
  await frames();
  pull(0);
  await frames();
}
