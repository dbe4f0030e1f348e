/** Trackers that are moved, renamed and forgotten, and lengths that a user knows: node trackers.mjs FOLDER PICTURES */

import { createRequire } from "node:module";
import { scenario, serveFolder } from "../page.mjs";

const [folder, pictures] = process.argv.slice(2);
const AXE = createRequire(import.meta.url).resolve("axe-core/axe.min.js");
const site = await serveFolder(folder);

await scenario({ viewport: { width: 1280, height: 800 }, serviceWorkers: "block" }, async (page) => {
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 50,
    });
  const open = async () => {
    await says("#rate", "completed here");
    await page.dispatchEvent("#settings", "click");
    await page.selectOption("#set", "feet");
    await says("#summary", "6 points");
  };
  const rows = () =>
    page.$$eval("#tracker-list li", (items) =>
      items.map((item) => [item.querySelector("input").value, item.querySelector("select").value]),
    );
  /** The median error against the truth that the page says, cm, over some seconds of the performance. */
  const error = async () => {
    await page.waitForTimeout(1500);
    return page.evaluate(async () => {
      const found = [];
      while (found.length < 20) {
        await new Promise((done) => setTimeout(done, 160));
        found.push(Number(/([\d.]+) cm from/.exec(document.getElementById("summary").textContent)?.[1]));
      }
      return found.sort((a, b) => a - b)[10];
    });
  };
  await page.goto(site.address);
  await open();
  const facts = { rows: [await rows()], off: [await error()] };
  await page.selectOption("#worn-left_ankle", "right_ankle"); // swaps both
  const isWorn = (joint) =>
    page.waitForFunction((wanted) => document.getElementById("worn-right_ankle").value === wanted, joint, {
      polling: 50,
    });
  await isWorn("left_ankle");
  facts.rows.push(await rows());
  facts.off.push(await error());
  await page.fill("#tracker-pelvis", "Belt");
  await page.locator("#tracker-pelvis").blur();
  await page.locator("#tracker-list").scrollIntoViewIfNeeded();
  await page.screenshot({ path: `${pictures}/trackers.png` });
  await page.addScriptTag({ path: AXE });
  facts.axe = await page.evaluate(async () =>
    (await axe.run()).violations.map(({ id, nodes }) => `${id}: ${nodes[0].html}`),
  );
  await page.dispatchEvent("#tracker-list li:nth-child(2) button", "click");
  await isWorn("right_ankle");
  facts.rows.push(await rows());
  facts.off.push(await error());
  await page.reload();
  await open();
  facts.rows.push(await rows());

  await page.evaluate(() => (document.querySelector("details").open = true));
  facts.shown = await page.$$eval("#length-list input, #height", (fields) =>
    fields.map(({ id, placeholder }) => [id, Number(placeholder)]),
  );
  await page.fill("#thigh", "3");
  await page.locator("#thigh").blur();
  await says("#notice-text", "3 m");
  facts.refused = await page.textContent("#notice-text");
  await page.fill("#thigh", "0.5");
  await page.locator("#thigh").blur();
  await page.screenshot({ path: `${pictures}/lengths.png` });
  facts.canForget = [await page.isVisible("#forget")];
  await page.reload();
  await open();
  facts.kept = await page.inputValue("#thigh");
  await page.dispatchEvent("#forget", "click");
  facts.canForget.push(await page.isVisible("#forget"));
  facts.forgotten = await page.inputValue("#thigh");
  return facts;
}).finally(() => site.close());
