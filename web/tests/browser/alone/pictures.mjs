/** Pictures of the page as a graphics card draws it: node pictures.mjs FOLDER PICTURES [NAME …]; all without a name. */

import { wearEmulated } from "../emulated_headset.mjs";
import { launched, serveFolder } from "../page.mjs";

const [folder, pictures, ...names] = process.argv.slice(2);
const site = await serveFolder(folder);
const SECONDS = 1; // of the performance that pass before a picture

/** A clock that runs as fast as pictures are drawn, and no word of what draws them. */
function unhurried() {
  let milliseconds = 0;
  window.requestAnimationFrame = (call) => setTimeout(() => call((window.pictureTime = milliseconds += 40)), 150);
  const ask = WebGL2RenderingContext.prototype.getParameter;
  const UNMASKED_RENDERER = 0x9246;
  WebGL2RenderingContext.prototype.getParameter = function (name) {
    return name === UNMASKED_RENDERER ? "a graphics card" : ask.call(this, name);
  };
}

async function picture(name, options, before = async () => undefined, after = async () => undefined) {
  if (names.length > 0 && !names.includes(name)) return;
  await launched([], { isCalm: false, ...options }, async (page) => {
    await page.addInitScript(unhurried);
    await before(page);
    await page.goto(site.address);
    const says = (id, part) =>
      page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
        polling: 100,
      });
    await says("#rate", "completed here");
    await after(page, says);
    await page.addStyleTag({ content: "#rate { display: none }" }); // where no graphics card draws it tells nothing
    const then = await page.evaluate(() => window.pictureTime);
    await page.waitForFunction((until) => window.pictureTime > until, then + 1000 * SECONDS, { polling: 100 });
    await page.screenshot({ path: `${pictures}/${name}.png` });
  });
}

const desk = { viewport: { width: 1280, height: 800 } };
await picture("desktop-light", { ...desk, colorScheme: "light" });
await picture("desktop-dark", { ...desk, colorScheme: "dark" });
await picture("phone", {
  viewport: { width: 390, height: 844 },
  deviceScaleFactor: 2,
  isMobile: true,
  colorScheme: "dark",
});
await picture("mirror", { ...desk, colorScheme: "light" }, wearEmulated, async (page, says) => {
  await page.dispatchEvent("#open-headset", "click");
  await says("#source", "headset");
  await says("#summary", "3 points");
  await page.evaluate(() => {
    device.controllers.left.position.set(-0.3, 1.25, -0.3);
    device.controllers.right.position.set(0.25, 1.5, -0.35);
  });
});
site.close();
