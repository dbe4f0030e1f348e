/** Files dropped one after the other, and what the page makes of each: node files.mjs FOLDER PICTURES FILE …
 *
 * The last one is an avatar that Draco packed.
 */

import { readFileSync } from "node:fs";
import { basename } from "node:path";
import { packedBox, vrmBytes } from "../../vrm_file.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [folder, pictures, ...files] = process.argv.slice(2);
const LIMBS = {
  hip: "UpperLeg",
  knee: "LowerLeg",
  ankle: "Foot",
  shoulder: "UpperArm",
  elbow: "LowerArm",
  wrist: "Hand",
};
const MIDDLE = { pelvis: "hips", spine1: "spine", head: "head" };
const boneOf = (joint) => {
  const [side, part] = joint.split("_");
  return MIDDLE[joint] ?? (part in LIMBS ? side + LIMBS[part] : null);
};
const given = files.map((file) => [basename(file), readFileSync(file)]);
given.push(["packed.vrm", vrmBytes(boneOf, "1", await packedBox())]);
const site = await serveFolder(folder);

await scenario({ viewport: { width: 900, height: 520 }, serviceWorkers: "block" }, async (page) => {
  await page.goto(site.address);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  await says("#rate", "completed here");
  const made = {};
  for (const [name, buffer] of given) {
    const began = Date.now();
    await page.setInputFiles("#file", { name, mimeType: "application/octet-stream", buffer });
    const isTaken = (taken) => {
      const text = (id) => document.getElementById(id).textContent;
      const avatar = document.getElementById("avatar").value;
      const isRefused = !document.getElementById("notice").hidden && text("notice-text").includes(taken);
      return isRefused || avatar === taken || (text("source").includes(taken) && text("summary").includes("tracked"));
    };
    await page.waitForFunction(isTaken, name, { polling: 100 });
    const seconds = (Date.now() - began) / 1000;
    if (await page.isHidden("#notice")) await page.waitForTimeout(2500); // a refusal may still come
    made[name] = await page.evaluate(
      (taken) => ({
        source: document.getElementById("source").textContent,
        summary: document.getElementById("summary").textContent,
        avatar: document.getElementById("avatar").value,
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
