/** A headset with two controllers that iwer emulates, worn before the page is opened, and what its wearer does.
 *
 * Nothing here waits for seconds: `window.headsetFrames(n)` waits for frames of the headset, however long they take.
 */

import { fileURLToPath } from "node:url";

const IWER = fileURLToPath(new URL("../../node_modules/iwer/build/iwer.min.js", import.meta.url));

/** The page finds it as `window.device`. */
export async function wearEmulated(page) {
  await page.addInitScript({ path: IWER });
  await page.addInitScript(() => {
    const device = (window.device = new IWER.XRDevice(IWER.metaQuest3));
    device.installRuntime({ forceInstall: true });
    device.position.set(0.4, 1.6, 0.2);
    device.quaternion.set(0, Math.sin(0.5), 0, Math.cos(0.5)); // turned to the left
    device.controllers.left.position.set(-0.25, 1.3, -0.4);
    device.controllers.right.position.set(0.25, 1.1, -0.35);
    window.headsetFrames = (count) =>
      new Promise((done) => {
        const next = () => (count-- > 0 ? device.activeSession.requestAnimationFrame(next) : done());
        next();
      });
  });
}

/** The headset is put on, by a button of the page, and the page shows its wearer. */
export async function putOn(page, control = "#open-headset") {
  await page.dispatchEvent(control, "click");
  await page.waitForSelector(`${control}[aria-busy=false]`, { state: "attached" });
  await page.evaluate(() => headsetFrames(4)); // from which on everything that the page says is of this wearer
  const isTracking = () =>
    document.getElementById("source").textContent.includes("headset") &&
    document.getElementById("summary").textContent.includes("3 points");
  await page.waitForFunction(isTracking, null, { polling: 50 });
}

/** The headset is taken off, and the page has heard of it. */
export async function takeOff(page) {
  await page.evaluate(() => {
    document.getElementById("notice").hidden = true;
    void device.activeSession.end();
  });
  await page.waitForSelector("#notice:not([hidden])", { state: "attached" });
}

/** Point at a row of the menu from half a metre and pull the trigger, or pinch: the menu is to the right of the mirror.
 *
 * `yaw`: how the wearer is turned, rad.
 */
export function pressMenu(page, row, { kind = "controllers", yaw = 0 } = {}) {
  return page.evaluate(press, [row, kind, yaw]);
}

async function press([row, kind, yaw]) {
  const turned = (angle, [x, y, z]) => [
    x * Math.cos(angle) + z * Math.sin(angle),
    y,
    z * Math.cos(angle) - x * Math.sin(angle),
  ];
  const sum = (...vectors) => [0, 1, 2].map((k) => vectors.reduce((total, vector) => total + vector[k], 0));
  const mirror = sum([device.position.x, 0, device.position.z], turned(yaw, [0, 0, -1.5]));
  const [height, above, step] = [0.935, 0.14, 0.087]; // m: of the board, over its rows, from row to row
  const down = [0, height / 2 - above - step * row - 0.04, 0];
  const input = device[kind].right;
  const before = [input.position.x, input.position.y, input.position.z];
  const pull = (value) =>
    kind === "hands" ? input.updatePinchValue(value) : input.updateButtonValue("trigger", value);
  input.position.set(...sum(mirror, turned(yaw, [1.12, 1.3, 0.35]), down, turned(yaw - 0.6, [0, 0, 0.5])));
  input.quaternion.set(0, Math.sin((yaw - 0.6) / 2), 0, Math.cos((yaw - 0.6) / 2));
  for (const value of [1, 0]) {
    await headsetFrames(4);
    pull(value);
  }
  await headsetFrames(4);
  input.position.set(...before);
  input.quaternion.set(0, 0, 0, 1);
}
