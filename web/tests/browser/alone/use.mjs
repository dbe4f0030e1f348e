/** What a person does on the page alone, without a server: node use.mjs FOLDER PICTURES MOTION.bvh */

import { createRequire } from "node:module";
import { readFileSync } from "node:fs";
import { gunzipSync } from "node:zlib";
import { scenario, serveFolder } from "../page.mjs";

const [folder, pictures, motion] = process.argv.slice(2);
const AXE = createRequire(import.meta.url).resolve("axe-core/axe.min.js");
const site = await serveFolder(folder);

await scenario({ viewport: { width: 900, height: 420 } }, async (page) => {
  await page.goto(site.address);
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const text = (id) => page.textContent(id);
  const notice = async (part) => (await until("#notice-text", part), text("#notice-text"));
  await until("#summary", "tracked");
  const facts = {};
  await until("#rate", "completed here");
  await until("#summary", "from the truth");
  facts.summary = await text("#summary");

  await page.addScriptTag({ path: AXE });
  await page.dispatchEvent("#settings", "click");
  facts.faults = await page.evaluate(async () => {
    const { violations } = await axe.run();
    return violations
      .filter(({ impact }) => impact === "serious" || impact === "critical")
      .map(({ id, nodes }) => [id, nodes.length, nodes[0].html]);
  });

  // Heights that no person has are said, and the timeline stays where the height changes.
  const length = () => page.evaluate(() => Number(document.getElementById("scrub").max));
  const before = await length();
  facts.heights = [];
  for (const height of ["0.2", "9"]) {
    await page.fill("#height", height);
    await page.locator("#height").blur();
    facts.heights.push(await notice(`${height} m`));
  }
  await page.fill("#height", "1.62");
  await page.locator("#height").blur();
  await page.waitForTimeout(500);
  facts.timelineKept = (await length()) >= before;

  // Space ticks a box and does not stop the motion.
  const isPlaying = () => page.getAttribute("#play", "data-state");
  await page.focus("#hold-feet");
  await page.keyboard.press("Space");
  facts.spaceOnBox = [await isPlaying(), await page.isChecked("#hold-feet")];
  await page.focus("#view");
  await page.keyboard.press("Space");
  await page.waitForTimeout(600);
  facts.spaceOnStage = await isPlaying();
  await page.keyboard.press("l");

  // A part is switched off.
  const part = page.locator("#parts label", { hasText: "Left hand" }).locator("input");
  await part.dispatchEvent("click");
  await until("#summary", "2 points");
  await part.dispatchEvent("click");

  // The legend is there as long as colours mean something.
  const legend = () => page.isVisible("#legend");
  await page.locator("input[name=figure][value=figure]").dispatchEvent("click");
  await page.selectOption("#colouring", "confidence");
  await page.waitForSelector("#legend:not([hidden])");
  await page.selectOption("#colouring", "plain");
  await page.waitForTimeout(600);
  facts.legend = [await legend()];
  await page.selectOption("#colouring", "hidden");
  await page.waitForSelector("#legend:not([hidden])");
  await page.locator("input[name=figure][value=avatar]").dispatchEvent("click");
  await page.waitForTimeout(600);
  facts.legend.push(await legend());

  for (const kind of ["bvh", "glb", "vrma"]) {
    const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent(`#save-${kind}`, "click")]);
    await download.saveAs(`${pictures}/motion.${kind}`);
  }

  const drop = (name, content) =>
    page.setInputFiles("#file", { name, mimeType: "application/octet-stream", buffer: content });
  await drop("song.mp3", Buffer.alloc(100));
  facts.song = await notice("song.mp3");
  await drop("broken.vrm", Buffer.from("glTF nothing follows"));
  facts.broken = await notice("broken.vrm");
  await drop(
    "dog.bvh",
    Buffer.from(
      "HIERARCHY\nROOT Tail\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n}\nMOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n",
    ),
  );
  facts.dog = await notice("dog.bvh");
  const joint = (name, inside = "") =>
    `JOINT ${name}\n{\nOFFSET 0 10 5\nCHANNELS 3 Zrotation Xrotation Yrotation\n${inside}}\n`;
  const legs = ["FrontLeft", "FrontRight", "RearLeft", "RearRight"].map((leg) => joint(`${leg}Paw`)).join("");
  const hound = joint("Spine", joint("Neck", joint("Head"))) + joint("Tail1", joint("Tail2")) + legs;
  const root = "ROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n";
  const still = Array(3 * 11)
    .fill(0)
    .join(" ");
  await drop("hound.bvh", Buffer.from(`HIERARCHY\n${root}${hound}}\nMOTION\nFrames: 1\nFrame Time: 0.1\n${still}\n`));
  facts.hound = await notice("hound.bvh");
  await drop("film.mp4", Buffer.alloc(100));
  facts.film = await notice("film.mp4");
  await drop("other.vrm", gunzipSync(readFileSync(`${folder}/avatar.vrm.gz`)));
  await page.waitForFunction(() => document.querySelector("#avatar").value === "other.vrm", null, { polling: 100 });
  facts.avatars = await page.evaluate(() => [...document.querySelector("#avatar").options].map(({ value }) => value));
  await page.selectOption("#avatar", "The page's own");
  await drop("walk.bvh", readFileSync(motion));
  await until("#source", "walk.bvh");
  await until("#summary", "from the truth");
  facts.dropped = await text("#summary");
  await page.dispatchEvent("#open-headset", "click");
  facts.headset = await notice("eadset");
  facts.webcam = await page.isVisible("#open-webcam");
  await page.screenshot({ path: `${pictures}/use.png` });

  // The network is gone: everything still works.
  await page.waitForFunction(() => navigator.serviceWorker.controller !== null, null, { polling: 100 });
  facts.sent = site.sent();
  site.close();
  await page.context().setOffline(true);
  await page.reload();
  await until("#summary", "from the truth");
  facts.offline = await text("#summary");
  return facts;
});
process.exit(0);
