/** What a person does on the page, against the fake server: node use.mjs FOLDER */

import { vrmBytes } from "../vrm_file.mjs";
import { fakeServer } from "./fake_server.mjs";
import { scenario, servePage } from "./page.mjs";

const [folder] = process.argv.slice(2);
const HUMAN = { pelvis: "hips", spine1: "spine", neck: "neck", head: "head" };
const LIMB = {
  shoulder: "UpperArm",
  elbow: "LowerArm",
  wrist: "Hand",
  hip: "UpperLeg",
  knee: "LowerLeg",
  ankle: "Foot",
};
const boneOf = (joint) => {
  const [side, part] = joint.split("_");
  return HUMAN[joint] ?? (part in LIMB ? side + LIMB[part] : null);
};

const site = await servePage();
await scenario({ viewport: { width: 1000, height: 600 } }, async (page) => {
  const heard = await fakeServer(page);
  await page.goto(site.address);
  const moves = () =>
    page.waitForFunction(() => document.querySelector("#rate").textContent.includes("Hz"), null, { polling: 100 });
  await moves();
  const notice = () => page.textContent("#notice-text");
  const facts = { unnamed: await unnamed(page), saved: await save(page), keys: await keys(page) };

  const drop = (name, content) =>
    page.setInputFiles("#avatar-file", { name, mimeType: "application/octet-stream", buffer: content });
  await drop("song.mp3", Buffer.alloc(100));
  await page.waitForSelector("#notice:not([hidden])");
  facts.wrongAvatar = await notice();
  await page.getByRole("button", { name: "Close this message" }).click();
  await dropHuge(page);
  await page.waitForSelector("#notice:not([hidden])");
  facts.hugeAvatar = await notice();
  await drop("boxes.vrm", vrmBytes(boneOf));
  await page.getByRole("button", { name: "Back to capsules" }).waitFor();
  await page.waitForTimeout(1000);
  await page.screenshot({ path: `${folder}/avatar.png` });
  facts.noticeAfterAvatar = await page.isVisible("#notice");
  await page.getByRole("button", { name: "Back to capsules" }).click();

  await page.getByText("Person", { exact: true }).click();
  await page.getByLabel("Height (m)").fill("1.83");
  await page.getByLabel("Seated").check();
  await page.getByLabel("Fingers").uncheck();
  await page.getByRole("button", { name: "Recentre" }).click();
  await page.getByLabel("Left hand").uncheck();
  await page.waitForTimeout(300);
  facts.told = heard.filter(({ type }) => type !== "hello" && type !== "signal");
  await page.getByLabel("Theme").selectOption("dark");
  await page.goto(site.address);
  await moves();
  facts.helloAfterReload = heard.filter(({ type }) => type === "hello").at(-1);
  facts.themeAfterReload = await page.getAttribute("html", "data-theme");
  return facts;
});
site.close();

/** Controls that a screen reader could not name. */
function unnamed(page) {
  return page.$$eval("button, input, select, canvas[tabindex]", (controls) =>
    controls
      .filter((control) => {
        const labels = [...(control.labels ?? [])].map((label) => label.textContent.trim()).join("");
        return !(
          control.getAttribute("aria-label") ||
          labels ||
          (control.tagName === "BUTTON" && control.textContent.trim())
        );
      })
      .map((control) => control.id),
  );
}

async function save(page) {
  await page.getByText("Save", { exact: true }).click();
  const names = [];
  for (const [button, name] of [
    ["BVH", "motion.bvh"],
    ["glTF (.glb)", "motion.glb"],
  ]) {
    const [download] = await Promise.all([
      page.waitForEvent("download"),
      page.getByRole("button", { name: button }).click(),
    ]);
    await download.saveAs(`${folder}/${name}`);
    names.push(download.suggestedFilename());
  }
  return names;
}

/** Space pauses, an arrow steps a frame back, L is live again. */
async function keys(page) {
  const until = (check, from) => page.waitForFunction(check, from, { polling: 100 });
  const place = () => page.$eval("#scrub", (slider) => Number(slider.value));
  await page.click("h1");
  await page.keyboard.press("Space");
  await until(() => document.querySelector("#play").textContent === "Play");
  const at = await place();
  await page.keyboard.press("ArrowLeft");
  await until((before) => Number(document.querySelector("#scrub").value) < before, at);
  const stepped = at - (await place());
  const whilePaused = await page.getAttribute("#live", "aria-pressed");
  await page.keyboard.press("l");
  await until(() => document.querySelector("#live").ariaPressed === "true");
  return { stepped, whilePaused, button: await page.textContent("#play") };
}

/** A file of 300 MB that takes no memory: the page must refuse it unread. */
async function dropHuge(page) {
  await page.evaluate(() => {
    const piece = new Blob([new Uint8Array(1e6)]);
    const transfer = new DataTransfer();
    transfer.items.add(new File(Array(300).fill(piece), "huge.vrm"));
    dispatchEvent(new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true }));
  });
}
