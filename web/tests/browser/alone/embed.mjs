/** The page in a frame of another page, as docs/page.md shows it: node embed.mjs FOLDER AROUND.html MOTION.bvh PICTURE */

import { readFileSync } from "node:fs";
import { createServer } from "node:http";
import { gunzipSync } from "node:zlib";
import { launched, scenario, serveFolder } from "../page.mjs";

const [folder, around, motion, picture] = process.argv.slice(2);
const site = await serveFolder(folder);
const origin = site.address.slice(0, -1);
const html = readFileSync(around, "utf8").replaceAll("http://localhost:8000", origin);
// Another origin, and a real host: Chromium lets no page that a test makes up frame a page of this machine.
const other = createServer((request, response) => {
  const content = request.url === "/named" ? html.replace("?embed&", "?embed=https://example.org&") : html;
  response.setHeader("content-type", "text/html").end(content);
});
await new Promise((done) => other.listen(0, "127.0.0.1", done));
const avatar = gunzipSync(readFileSync(`${folder}/avatar.vrm.gz`));

/** Open the page around the frame; all that it hears is in `heard`. */
async function open(page, path) {
  await page.route(/\/\w+\.bvh$/, (route) => {
    const isThere = !route.request().url().endsWith("nowhere.bvh");
    return isThere ? route.fulfill({ body: readFileSync(motion) }) : route.fulfill({ status: 404 });
  });
  await page.route(/\/other\.vrm$/, (route) => route.fulfill({ body: avatar }));
  await page.addInitScript(() => {
    if (top !== window) return;
    window.heard = [];
    addEventListener("message", ({ data }) => window.heard.push(data));
  });
  await page.goto(`http://127.0.0.1:${other.address().port}${path}`);
  const heard = () => page.evaluate(() => window.heard);
  return {
    heard,
    /** Wait for an event of these values, after the first `from`. */
    until: (event, from = 0) =>
      page.waitForFunction(
        ([values, first]) =>
          window.heard.slice(first).some((one) => Object.entries(values).every(([name, value]) => one[name] === value)),
        [event, from],
        { polling: 100 },
      ),
    send: (command) =>
      page.evaluate(
        ([what, to]) => document.getElementById("body").contentWindow.postMessage(what, to),
        [command, origin],
      ),
    now: async () => (await heard()).length,
  };
}

const options = { viewport: { width: 520, height: 580 }, serviceWorkers: "block" };
const uninvited = await launched([], options, async (page) => {
  const { heard } = await open(page, "/named");
  await page.frameLocator("#body").locator("html[data-embed]").waitFor({ state: "attached" });
  await page.waitForTimeout(6000);
  return heard();
});
await scenario({ ...options, expected: /404/ }, async (page) => {
  const { heard, until, send, now } = await open(page, "/");
  await page.addStyleTag({ content: "body { background: rgb(250, 200, 90) }" });
  const facts = {};
  await until({ bodysense: "loaded", kind: "motion", name: "walk.bvh" });
  await until({ bodysense: "time", playing: true });
  facts.first = (await heard()).filter(({ bodysense }) => bodysense !== "time").map(({ bodysense }) => bodysense);
  await page.waitForTimeout(3000); // the avatar comes
  await page.screenshot({ path: picture });

  // By the buttons, twice each and in another order.
  facts.paused = [];
  for (const id of ["play", "pause", "pause", "play", "pause"]) {
    const from = await now();
    await page.click(`#${id}`);
    await until({ bodysense: "time", playing: id === "play" }, from);
  }
  await page.waitForTimeout(1000);
  const still = await now();
  await page.waitForTimeout(1000);
  facts.whilePaused = (await now()) - still;
  for (const time of [0.4, 0.2, 0.2, 1e9]) {
    const from = await now();
    await send({ bodysense: "seek", time });
    await page.waitForFunction((first) => window.heard.length > first, from, { polling: 100 });
    facts.paused.push((await heard())[from]);
  }

  // Another window cannot steer the frame.
  const before = await now();
  await page.evaluate((to) => {
    const other = document.body.appendChild(document.createElement("iframe"));
    other.srcdoc = `<script>parent.frames[0].postMessage({ bodysense: "play" }, "${to}")</script>`;
  }, origin);
  await page.waitForTimeout(1500);
  facts.byAnother = (await now()) - before;

  // To the end, once, and again.
  await send({ bodysense: "seek", time: 0 });
  await send({ bodysense: "play", repeat: false });
  await until({ bodysense: "ended" }, before);
  facts.end = (await heard()).slice(-2);
  const ended = await now();
  await send({ bodysense: "play" });
  await until({ bodysense: "ended" }, ended);
  facts.endedTwice = (await heard()).slice(before).filter(({ bodysense }) => bodysense === "ended").length;

  // Of two motions on their way the newest counts; files come as well.
  const loads = await now();
  await send({ bodysense: "load", motion: "first.bvh" });
  await send({ bodysense: "load", motion: "second.bvh", avatar: "other.vrm" });
  await until({ bodysense: "loaded", name: "other.vrm" }, loads);
  await until({ bodysense: "loaded", name: "second.bvh" }, loads);
  await page.evaluate(
    ([text, to]) =>
      document
        .getElementById("body")
        .contentWindow.postMessage({ bodysense: "load", motion: new File([text], "mine.bvh") }, to),
    [readFileSync(motion, "utf8"), origin],
  );
  await until({ bodysense: "loaded", name: "mine.bvh" }, loads);
  facts.loaded = (await heard()).slice(loads).flatMap(({ bodysense, name }) => (bodysense === "loaded" ? [name] : []));

  // What cannot be is one line, and what was there plays on.
  const faults = await now();
  await send({ bodysense: "dance" });
  await send({ bodysense: "load", motion: "nowhere.bvh" });
  await send({ motion: "of somebody else" });
  await page.waitForFunction(
    (first) => window.heard.slice(first).filter(({ bodysense }) => bodysense === "error").length === 2,
    faults,
    { polling: 100 },
  );
  facts.refused = (await heard()).slice(faults).flatMap(({ reason }) => reason ?? []);
  const after = await now();
  await until({ bodysense: "time", playing: true }, after);

  // Leaving and coming again; a listener that came late.
  const left = await now();
  await page.evaluate(() => {
    const frame = document.getElementById("body");
    frame.remove();
    document.body.prepend(frame);
  });
  await until({ bodysense: "loaded", name: "walk.bvh" }, left);
  const hello = await now();
  await send({ bodysense: "hello" });
  await until({ bodysense: "ready" }, hello);
  return { ...facts, uninvited };
}).finally(() => [site, other].forEach((host) => host.close()));
