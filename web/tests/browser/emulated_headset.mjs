/** A headset with two controllers that iwer emulates, worn before the page is opened. */

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
  });
}
