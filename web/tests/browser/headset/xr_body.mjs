/** The example of WebXR's body in an emulated headset, entered twice: node xr_body.mjs FOLDER PICTURES */

import { wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario({ viewport: { width: 960, height: 480 } }, async (page) => {
  await wearEmulated(page);
  await page.goto(site.address);
  const enter = async () => {
    await page.getByText("ENTER VR").dispatchEvent("click");
    await page.waitForFunction(() => device.activeSession, null, { polling: 50 });
    return page.evaluate(look, [0.15, 1.05, -0.1]);
  };
  const first = await enter();
  await page.screenshot({ path: `${pictures}/lowered.png` });
  const raised = await page.evaluate(look, [0.1, 1.75, 0.1]);
  await page.screenshot({ path: `${pictures}/raised.png` });
  await page.evaluate(() => device.activeSession.end());
  await page.getByText("ENTER VR").waitFor({ state: "attached" });
  const second = await enter();
  return { first, raised, second };
});
site.close();

/** The body after some frames with the left controller at a place: how many joints it has, and where some are. */
async function look([x, y, z]) {
  device.position.set(0.4, 1.6, 0.2);
  device.quaternion.set(0, 0, 0, 1);
  device.controllers.right.position.set(0.65, 1.05, -0.1);
  device.controllers.left.position.set(x, y, z);
  await headsetFrames(40);
  const session = device.activeSession;
  const floor = await session.requestReferenceSpace("local-floor");
  return new Promise((done) =>
    session.requestAnimationFrame((_, frame) => {
      const names = ["head", "hips", "left-hand-wrist", "left-arm-lower", "left-foot-ball", "right-foot-ball"];
      const at = (name) => {
        const { x, y, z } = frame.getPose(frame.body.get(name), floor).transform.position;
        return [x, y, z];
      };
      const { enabledFeatures } = session;
      done({ size: frame.body.size, enabledFeatures, ...Object.fromEntries(names.map((name) => [name, at(name)])) });
    }),
  );
}
