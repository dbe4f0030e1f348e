/** A wearer of an emulated headset against a running server: node wear.mjs ADDRESS PICTURE
 *
 * iwer stands for the headset: first with two controllers, then with two hands.
 */

import { fileURLToPath } from "node:url";
import { scenario } from "./page.mjs";

const [address, picture] = process.argv.slice(2);
const IWER = fileURLToPath(new URL("../../node_modules/iwer/build/iwer.min.js", import.meta.url));

await scenario({ colorScheme: "dark", viewport: { width: 900, height: 500 } }, async (page) => {
  await page.addInitScript({ path: IWER });
  await page.addInitScript(() => {
    window.device = new IWER.XRDevice(IWER.metaQuest3);
    window.device.installRuntime({ forceInstall: true });
    window.device.position.set(0, 1.6, 0);
    window.device.controllers.left.position.set(-0.25, 1.3, -0.4);
    window.device.controllers.right.position.set(0.25, 1.1, -0.35);
    const send = WebSocket.prototype.send; // to see how many points leave
    WebSocket.prototype.send = function (data) {
      if (typeof data !== "string") window.joints = new DataView(data).getUint16(2, true);
      return send.call(this, data);
    };
  });
  await page.goto(address);
  const answered = () =>
    page.waitForFunction(() => document.querySelector("#rate").textContent.includes("Hz"), null, { polling: 100 });
  const text = (id) => page.textContent(id);
  await page.getByRole("button", { name: "Enter VR" }).click();
  await page.waitForFunction(
    () => document.querySelector("#status").textContent.includes("left wrist, right wrist measured"),
    null,
    {
      polling: 100,
    },
  );
  await answered();
  await page.waitForTimeout(2500);
  const controllers = { status: await text("#status"), rate: await text("#rate"), there: await text("#plots") };
  await page.screenshot({ path: picture });
  await page.evaluate(() => {
    window.device.primaryInputMode = "hand";
    window.device.hands.left.position.set(-0.2, 1.45, -0.35);
    window.device.hands.right.position.set(0.2, 1.45, -0.35);
  });
  await page.waitForFunction(() => window.joints === 51, null, { polling: 100 });
  await page.waitForTimeout(3000);
  const hands = {
    status: await text("#status"),
    rate: await text("#rate"),
    joints: await page.evaluate(() => window.joints),
  };
  await page.screenshot({ path: picture.replace(".png", "_hands.png") });
  await page.evaluate(() => window.device.activeSession?.end());
  await page.waitForTimeout(1500);
  return {
    controllers,
    hands,
    after: await text("#status"),
    notice: await page.isVisible("#notice"),
    said: await text("#notice-text"),
  };
});
