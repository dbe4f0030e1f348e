/** Files dropped one after the other, and what the page makes of each: node files.mjs FOLDER PICTURES FILE … */

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { scenario, serveFolder } from "./page.mjs";

const [folder, pictures, ...files] = process.argv.slice(2);
const site = await serveFolder(folder);

await scenario({ viewport: { width: 900, height: 520 }, serviceWorkers: "block" }, async (page) => {
  await page.goto(site.address);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  await says("#rate", "completed here");
  const made = {};
  for (const file of files) {
    const name = basename(file);
    const began = Date.now();
    await page.setInputFiles("#file", { name, mimeType: "application/octet-stream", buffer: readFileSync(file) });
    const isTaken = (taken) => {
      const text = (id) => document.getElementById(id).textContent;
      const worn = document.getElementById("avatar").value;
      const isRefused = !document.getElementById("notice").hidden && text("notice-text").includes(taken);
      return isRefused || worn === taken || (text("source").includes(taken) && text("shown").includes("tracked"));
    };
    await page.waitForFunction(isTaken, name, { polling: 100 });
    const seconds = (Date.now() - began) / 1000;
    await page.waitForTimeout(2500);
    made[name] = await page.evaluate(
      (taken) => ({
        source: document.getElementById("source").textContent,
        shown: document.getElementById("shown").textContent,
        worn: document.getElementById("avatar").value,
        notice: document.getElementById("notice").hidden ? null : document.getElementById("notice-text").textContent,
        taken,
      }),
      name,
    );
    made[name].seconds = seconds;
    await page.screenshot({ path: `${pictures}/${name}.png` });
    await page.evaluate(() => document.getElementById("notice-close").click());
  }
  return { made };
});
site.close();
