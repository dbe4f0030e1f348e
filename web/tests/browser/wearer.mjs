/** A wearer of an emulated headset who measures, crouches, sits and stands up: node wearer.mjs FOLDER PICTURES
 *
 * Bodies are read as a person gets them: as saved BVH.
 */

import { wearEmulated } from "./emulated_headset.mjs";
import { scenario, serveFolder } from "./page.mjs";

const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario(
  { colorScheme: "light", viewport: { width: 480, height: 320 }, serviceWorkers: "block" },
  async (page) => {
    await wearEmulated(page);
    await page.goto(site.address);
    const text = (id) => page.textContent(id);
    const says = (id, part) =>
      page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
        polling: 50,
      });
    const stand = (eyes) =>
      page.evaluate((height) => {
        device.position.set(0, height, 0);
        device.quaternion.set(0, 0, 0, 1);
        device.controllers.left.position.set(-0.3, height - 0.65, -0.1);
        device.controllers.right.position.set(0.3, height - 0.65, -0.1);
      }, eyes);
    const armsOut = (eyes, reach) =>
      page.evaluate(
        ([height, half]) => {
          device.controllers.left.position.set(-half, height - 0.2, 0);
          device.controllers.right.position.set(half, height - 0.2, 0);
        },
        [eyes, reach / 2],
      );
    const enter = async () => {
      await page.dispatchEvent("#door-headset", "click");
      await says("#source", "headset");
      await says("#shown", "3 points");
    };
    const leave = async () => {
      await page.evaluate(() => device.activeSession.end());
      await page.waitForTimeout(400);
    };
    const measure = async (part) => {
      await page.evaluate(() => document.getElementById("notice-close").click());
      await page.dispatchEvent("#calibrate", "click");
      await says("#notice-text", part);
      return text("#notice-text");
    };
    const save = async (name) => {
      const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
      await download.saveAs(`${pictures}/${name}.bvh`);
    };
    const facts = {};
    await says("#rate", "completed here");
    await page.dispatchEvent("#settings", "click");

    // A tall wearer of whom nothing is known stands on the floor from the first second.
    await stand(1.85);
    await enter();
    await page.waitForTimeout(2500);
    await save("tall");
    await leave();

    // Who crouches is asked, who stands is measured, and both after a countdown.
    await stand(1.22);
    await enter();
    await armsOut(1.22, 1.4);
    await page.evaluate(() => {
      window.said = [];
      const notice = document.getElementById("notice-text");
      new MutationObserver(() => said.push(notice.textContent)).observe(notice, { childList: true });
    });
    facts.crouch = await measure("only");
    facts.countdown = await page.evaluate(() => [...new Set(said.flatMap((line) => /(\d) …$/.exec(line)?.[1] ?? []))]);
    await stand(1.7);
    await armsOut(1.7, 1.4);
    facts.measured = await measure("You are measured.");
    facts.hint = await text("#calibrate-hint");

    // They stay measured from source to source, and over a reload.
    await leave();
    await page.dispatchEvent("#door-performance", "click");
    await says("#source", "performance");
    await stand(1.7);
    await enter();
    await page.waitForTimeout(1500);
    await save("measured");
    await leave();
    await page.reload();
    await says("#rate", "completed here");
    await page.dispatchEvent("#settings", "click");
    facts.kept = await text("#calibrate-hint");

    // Taller begins at the body's own height.
    await stand(1.7);
    await enter();
    await page.waitForTimeout(800);
    await page.evaluate(press, [1, 0]);
    facts.taller = await page.inputValue("#height");
    await leave();
    await page.dispatchEvent("#forget", "click");
    await page.fill("#height", "");
    await page.locator("#height").blur();
    facts.forgotten = [await text("#calibrate-hint"), await page.isVisible("#forget")];

    // I am sitting counts before VR; in VR the page's box follows; who stands up does not fly.
    await page.locator("#seated").dispatchEvent("click");
    await stand(1.18);
    await enter();
    await page.waitForTimeout(2000);
    await save("seated");
    facts.seatedBox = [await page.isChecked("#seated")];
    await page.evaluate(press, [4, 0]);
    facts.seatedBox.push(await page.isChecked("#seated"));
    await page.evaluate(press, [4, 0]);
    facts.seatedBox.push(await page.isChecked("#seated"));
    await page.waitForTimeout(500);
    for (let eyes = 1.18; eyes <= 1.6; eyes += 0.03) {
      await stand(eyes);
      await page.waitForTimeout(60);
    }
    await page.waitForTimeout(1500);
    await page.screenshot({ path: `${pictures}/risen.png` });
    await leave();
    await save("risen");
    return facts;
  },
);
site.close();

/** Point at a row of the menu from half a metre and pull the trigger: the menu stands to the right of the mirror. */
async function press([row, yaw]) {
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
  const input = device.controllers.right;
  const before = [input.position.x, input.position.y, input.position.z];
  input.position.set(...place);
  input.quaternion.set(0, Math.sin((yaw - 0.6) / 2), 0, Math.cos((yaw - 0.6) / 2));
  const frames = () => new Promise((done) => setTimeout(done, 700));
  await frames();
  input.updateButtonValue("trigger", 1);
  await frames();
  input.updateButtonValue("trigger", 0);
  await frames();
  input.position.set(...before);
  input.quaternion.set(0, 0, 0, 1);
}
