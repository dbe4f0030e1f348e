/** What Lighthouse asks of a page, by name: node checks.mjs FOLDER */

import { createRequire } from "node:module";
import { scenario, serveFolder } from "../page.mjs";

const [folder] = process.argv.slice(2);
const AXE = createRequire(import.meta.url).resolve("axe-core/axe.min.js");
const site = await serveFolder(folder);

await scenario({ viewport: { width: 320, height: 700 }, colorScheme: "light" }, async (page) => {
  const elsewhere = [];
  const isOwn = (url) => url.startsWith(site.address) || url.startsWith(`blob:${site.address}`); // a blob is unpacked here
  page.on("request", (request) => isOwn(request.url()) || elsewhere.push(request.url()));
  await page.addInitScript(() => {
    window.shift = 0;
    const sum = (list) => list.getEntries().forEach(({ value, hadRecentInput }) => !hadRecentInput && (shift += value));
    new PerformanceObserver(sum).observe({ type: "layout-shift", buffered: true });
  });
  const completed = () =>
    page.waitForFunction(() => document.querySelector("#rate").textContent.includes("completed here"), null, {
      polling: 100,
    });
  await page.goto(site.address);
  await completed();
  const facts = { elsewhere, shift: await page.evaluate(() => shift) };
  facts.head = await page.evaluate(() => ({
    language: document.documentElement.lang,
    title: document.title,
    ...Object.fromEntries(
      [...document.querySelectorAll("meta[name]")].map(({ name, content }) => [name, content.length]),
    ),
  }));
  facts.sizes = await page.evaluate(() =>
    Object.fromEntries(
      performance
        .getEntriesByType("resource")
        .map(({ name, decodedBodySize }) => [name.split("/").pop(), decodedBodySize]),
    ),
  );

  // By keyboard alone, on a page where nothing had the focus yet: the doors come early, and what has the focus is seen.
  facts.keyboard = [];
  for (let press = 0; press < 9; press++) {
    await page.keyboard.press("Tab");
    facts.keyboard.push(
      await page.evaluate(() => {
        const { activeElement } = document;
        const isSeen = parseFloat(getComputedStyle(activeElement).outlineWidth) >= 2;
        return [activeElement.id || activeElement.className, isSeen];
      }),
    );
  }

  await page.dispatchEvent("#settings", "click");
  await page.addScriptTag({ path: AXE });
  facts.axe = {};
  for (const colorScheme of ["light", "dark"]) {
    await page.emulateMedia({ colorScheme });
    const isPainted = (look) => document.documentElement.dataset.look === look && document.getAnimations().length === 0;
    await page.waitForFunction(isPainted, colorScheme, { polling: 100 });
    facts.axe[colorScheme] = await page.evaluate(async () => {
      const { violations } = await axe.run();
      return violations.map(({ id, impact, nodes }) => `${id} (${impact}): ${nodes[0].html}`);
    });
  }
  // On a phone: nothing is wider than the screen, and everything is large enough for a finger.
  facts.tooWide = await page.evaluate(() => document.documentElement.scrollWidth - innerWidth);
  facts.tooSmall = await page.evaluate(() => {
    const least = 24; // px, WCAG 2.2
    const size = (found) => (found.closest("label") ?? found).getBoundingClientRect();
    return [...document.querySelectorAll("button, select, input:not(.unseen)")]
      .filter((found) => found.checkVisibility())
      .filter((found) => size(found).width < least || size(found).height < least)
      .map(({ id, type }) => id || type);
  });
  // On phones, upright and lying, a message leaves the body to be seen.
  facts.covered = [];
  for (const [width, height] of [
    [390, 844],
    [844, 390],
  ]) {
    await page.setViewportSize({ width, height });
    facts.covered.push(
      await page.evaluate(() => {
        const [notice, stage] = ["notice", "stage"].map((id) => document.getElementById(id));
        document.getElementById("notice-text").textContent =
          "A message of one line, as files that are refused have it.";
        notice.hidden = false;
        const covered = stage.getBoundingClientRect().bottom - notice.getBoundingClientRect().top;
        notice.hidden = true;
        return covered;
      }),
    );
  }
  // A webcam's picture is seen whole in windows of any size, whatever is open and wherever the page is scrolled to.
  facts.overPicture = {};
  await page.evaluate(() => (document.getElementById("camera").hidden = false));
  await page.evaluate(
    () => (document.getElementById("camera-says").textContent = "Nobody is seen. You were in 40 % of the pictures"),
  );
  for (const [width, height] of [
    [320, 568],
    [390, 844],
    [768, 1024],
    [568, 320],
    [844, 390],
    [833, 545],
    [900, 560],
    [1000, 640],
    [1280, 800],
    [1920, 1080],
  ]) {
    await page.setViewportSize({ width, height });
    for (const open of ["", "takes", "settings"]) {
      facts.overPicture[`${width} x ${height} ${open}`] = await page.evaluate(overPicture, open);
    }
  }
  await page.evaluate(() => (document.getElementById("camera").hidden = true));
  // On a lying phone the figure has most of the picture.
  await page.setViewportSize({ width: 844, height: 390 });
  facts.lying = await page.evaluate(() => document.getElementById("stage").clientHeight / innerHeight);
  // In windows of any height the introduction is between the header and the timeline.
  facts.introduced = {};
  for (const [width, height] of [
    [900, 560],
    [1000, 640],
    [1200, 730],
    [1280, 800],
    [1600, 900],
  ]) {
    await page.setViewportSize({ width, height });
    facts.introduced[`${width} x ${height}`] = await page.evaluate(() => {
      const boxes = ["header", "#intro", "#transport"].map((name) =>
        document.querySelector(name).getBoundingClientRect(),
      );
      return [boxes[1].top - boxes[0].bottom, boxes[2].top - boxes[1].bottom, boxes[1].height];
    });
  }
  // The second visit comes from this browser.
  await page.waitForFunction(() => navigator.serviceWorker.controller !== null, null, { polling: 100 });
  facts.fetchedAgain = [];
  page.on("response", (response) => {
    const { protocol, pathname } = new URL(response.url());
    if (!response.fromServiceWorker() && protocol !== "blob:") facts.fetchedAgain.push(pathname);
  });
  await page.reload();
  await completed();
  return facts;
}).finally(() => site.close());

/** What is over the webcam's picture or cuts it, with one panel open and the page scrolled to several places. */
function overPicture(open) {
  const CORNER = 7; // pixels: corners are round
  for (const name of ["takes", "settings"])
    if ((document.getElementById(name).ariaExpanded === "true") !== (name === open))
      document.getElementById(name).click();
  const { scrollingElement: scrolled } = document;
  const [start, most] = [scrolled.scrollTop, scrolled.scrollHeight - innerHeight];
  const found = new Set();
  for (const top of [start, 0, most / 3, most]) {
    scrolled.scrollTop = top;
    const box = document.getElementById("camera").getBoundingClientRect();
    if (Math.min(box.left, box.top, innerWidth - box.right, innerHeight - box.bottom) < 0)
      found.add("the window's edge");
    for (let k = 0; k < 49; k++) {
      const [x, y] = [(k % 7) / 6, Math.floor(k / 7) / 6];
      const over = document.elementFromPoint(
        box.left + CORNER + x * (box.width - 2 * CORNER),
        box.top + CORNER + y * (box.height - 2 * CORNER),
      );
      if (over && !over.closest("#camera")) found.add(over.id || over.outerHTML.slice(0, 80));
    }
  }
  scrolled.scrollTop = 0;
  return [...found];
}
