/** The page of a server whose input comes late, and of one without: node served.mjs FOLDER PICTURES */

import { fakeServer, WELCOME } from "../fake_server.mjs";
import { launched, scenario, serveFolder } from "../page.mjs";

const [folder, pictures] = process.argv.slice(2);
const site = await serveFolder(folder);
const until = (page, id, part) =>
  page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
    polling: 100,
  });
const seen = (page) =>
  page.evaluate(() => ({
    source: document.getElementById("source").textContent,
    lead: document.getElementById("lead").textContent.trim(),
    isNoticed: !document.getElementById("notice").hidden,
  }));

const without = await launched([], { viewport: { width: 1280, height: 800 } }, async (page) => {
  await fakeServer(page, (socket, message) => {
    if (message.type === "hello") socket.send(JSON.stringify({ ...WELCOME, sources: [] }));
    return true;
  });
  await page.goto(site.address);
  await until(page, "#lead", "no input");
  await until(page, "#source", "performance");
  await until(page, "#summary", "from the truth");
  const first = await seen(page);
  await page.screenshot({ path: `${pictures}/without.png` });
  await page.dispatchEvent("#open-server", "click");
  await until(page, "#notice-text", "no input");
  await page.screenshot({ path: `${pictures}/asked.png` });
  const [notice, title] = await page.evaluate(() =>
    ["notice", "title"].map((id) => document.getElementById(id).getBoundingClientRect().toJSON()),
  );
  return { first, isOverHeadline: notice.bottom > title.top && notice.right > title.left && notice.left < title.right };
});

await scenario({ viewport: { width: 900, height: 420 } }, async (page) => {
  let isThere = false;
  const heard = await fakeServer(page, (socket, message) => {
    if (message.type !== "hello" || message.watch !== "replay" || isThere) return false;
    socket.send(JSON.stringify(WELCOME)); // and nothing follows
    return true;
  });
  await page.goto(site.address);
  await until(page, "#source", "performance");
  await page.waitForTimeout(3000);
  const before = await seen(page);
  isThere = true;
  await page.dispatchEvent("#open-server", "click"); // a new request
  await until(page, "#source", "server's own input");
  await until(page, "#summary", "from the truth");
  const after = await seen(page);
  await page.dispatchEvent("#settings", "click");
  for (const id of ["#calibrate", "#recentre", "#seated"]) await page.locator(id).dispatchEvent("click");
  const notice = await page.textContent("#notice-text");
  await page.waitForTimeout(500);
  const requests = heard.filter(({ type }) => ["calibrate", "recentre", "settings"].includes(type));
  return { without, before, after, notice, requests };
}).finally(() => site.close());
