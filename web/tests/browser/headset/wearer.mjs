/** A wearer of an emulated headset who measures, crouches, sits and stands up: node wearer.mjs FOLDER PICTURES
 *
 * Bodies are read as a person gets them: as saved BVH. The page's clock goes on with its pictures, so that a busy machine
 * is slower and does nothing else.
 */

import { pressMenu, putOn, takeOff, wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [TALLER, SITTING] = [1, 4]; // rows of the menu
const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario(
  { colorScheme: "light", viewport: { width: 480, height: 320 }, serviceWorkers: "block" },
  async (page) => {
    await page.addInitScript(clockOfPictures);
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
    /** Wait until the timeline has so many seconds, or so many more. */
    const recorded = async (seconds, isMore = false) => {
      const length = () => page.evaluate(() => Number(scrub.max) - Number(scrub.min));
      const least = seconds + (isMore ? await length() : 0);
      await page.waitForFunction((wanted) => Number(scrub.max) - Number(scrub.min) >= wanted, least, { polling: 50 });
    };
    const seated = async (isSeated) => {
      await page.waitForFunction((wanted) => document.getElementById("seated").checked === wanted, isSeated, {
        polling: 50,
      });
      return page.isChecked("#seated");
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
    await putOn(page);
    await recorded(2.5);
    await save("tall");
    await takeOff(page);

    // Who crouches is asked, who stands is measured, and both after a countdown.
    await stand(1.22);
    await putOn(page);
    await armsOut(1.22, 1.4);
    await page.evaluate(() => {
      window.notices = [];
      const notice = document.getElementById("notice-text");
      new MutationObserver(() => notices.push(notice.textContent)).observe(notice, { childList: true });
    });
    facts.crouch = await measure("only");
    facts.countdown = await page.evaluate(() => [
      ...new Set(notices.flatMap((line) => /(\d) …$/.exec(line)?.[1] ?? [])),
    ]);
    await stand(1.7);
    await armsOut(1.7, 1.4);
    facts.measured = await measure("You are measured.");
    facts.hint = await text("#calibrate-hint");

    // They stay measured from source to source, and over a reload.
    await takeOff(page);
    await page.dispatchEvent("#open-performance", "click");
    await says("#source", "performance");
    await stand(1.7);
    await putOn(page);
    await recorded(1.5);
    await save("measured");
    await takeOff(page);
    await page.reload();
    await says("#rate", "completed here");
    await page.dispatchEvent("#settings", "click");
    facts.kept = await text("#calibrate-hint");

    // Taller begins at the body's own height.
    await stand(1.7);
    await putOn(page);
    await recorded(0.8);
    await pressMenu(page, TALLER);
    facts.taller = await page.inputValue("#height");
    await takeOff(page);
    await page.dispatchEvent("#forget", "click");
    await page.fill("#height", "");
    await page.locator("#height").blur();
    facts.forgotten = [await text("#calibrate-hint"), await page.isVisible("#forget")];

    // I am sitting counts before VR; in VR the page's box follows; who stands up does not fly.
    await page.locator("#seated").dispatchEvent("click");
    await stand(1.18);
    await putOn(page);
    await recorded(2);
    await save("seated");
    facts.seatedBox = [await seated(true)];
    await pressMenu(page, SITTING);
    facts.seatedBox.push(await seated(false));
    await pressMenu(page, SITTING);
    facts.seatedBox.push(await seated(true));
    await recorded(0.5, true);
    for (let eyes = 1.18; eyes <= 1.6; eyes += 0.03) {
      await stand(eyes);
      await page.evaluate(() => headsetFrames(1));
    }
    await recorded(1.5, true);
    await page.screenshot({ path: `${pictures}/risen.png` });
    await takeOff(page);
    await save("risen");
    return facts;
  },
);
site.close();

/** Pictures 0.15 s apart by the page's clock, which stands still between them. */
function clockOfPictures() {
  const BETWEEN = 150; // ms
  let now = performance.now();
  performance.now = () => now;
  window.requestAnimationFrame = (call) => setTimeout(() => call((now += BETWEEN)), BETWEEN);
}
