/** Pictures of the page one after the other, by a clock of their own: node record_page.mjs SITE PICTURES SECONDS RATE
 *
 * The page is the real one in headless Chromium, drawn as a graphics card draws it, however long each picture takes.
 */

import { launched, serveFolder } from "../web/tests/browser/page.mjs";

const [folder, pictures, seconds, rate] = process.argv.slice(2);
const STEPS = 2; // steps of the page from picture to picture: bodies are completed twice as often as they are shown
const SETTLED = 24; // steps until the avatar is on the stage and the camera is in its place
const viewport = { width: 1120, height: 640 };
const site = await serveFolder(folder);

/** The page's clock goes on when `stepPage` says so; nothing tells what draws. */
function steered(milliseconds) {
  let [now, queue] = [0, []];
  window.requestAnimationFrame = (call) => queue.push(call);
  window.stepPage = async () => {
    now += milliseconds;
    for (const call of queue.splice(0)) call(now);
    await new Promise((done) => setTimeout(done, 60)); // the worker completes the body
  };
  const ask = WebGL2RenderingContext.prototype.getParameter;
  const UNMASKED_RENDERER = 0x9246;
  WebGL2RenderingContext.prototype.getParameter = function (name) {
    return name === UNMASKED_RENDERER ? "a graphics card" : ask.call(this, name);
  };
}

await launched([], { isCalm: false, viewport, colorScheme: "light" }, async (page) => {
  await page.addInitScript(steered, 1000 / rate / STEPS);
  await page.goto(site.address);
  const step = () => page.evaluate(() => window.stepPage());
  const isTrue = (check) => page.evaluate(check);
  const isCompleted = () => document.getElementById("rate").textContent.includes("completed here");
  const hasAvatar = () => document.getElementById("avatar").options.length > 0;
  await page.addStyleTag({ content: "#rate { visibility: hidden }" }); // where no graphics card draws it tells nothing
  while (!(await isTrue(isCompleted)) || !(await isTrue(hasAvatar))) {
    await page.waitForTimeout(500);
    await step();
  }
  for (let k = 0; k < SETTLED; k++) await step();
  for (let picture = 0; picture < seconds * rate; picture++) {
    for (let k = 0; k < STEPS; k++) await step();
    await page.screenshot({ path: `${pictures}/${String(picture).padStart(4, "0")}.png` });
  }
});
site.close();
