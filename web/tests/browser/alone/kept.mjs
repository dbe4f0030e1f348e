/** Storage that is full is said, and a take is there after a reload: node kept.mjs FOLDER RESULT.bvh */

import { scenario, serveFolder } from "../page.mjs";

const [folder, result] = process.argv.slice(2);
const site = await serveFolder(folder);
await scenario({ viewport: { width: 1000, height: 700 } }, async (page) => {
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const record = async (milliseconds) => {
    await page.dispatchEvent("#record", "click");
    await page.waitForTimeout(milliseconds);
    await page.dispatchEvent("#record", "click");
  };
  const session = await page.context().newCDPSession(page);
  const { origin } = new URL(site.address);
  await session.send("Storage.overrideQuotaForOrigin", { origin, quotaSize: 1 });
  await page.goto(site.address);
  await until("#rate", "completed here");
  await record(2000);
  await until("#notice-text", "storage");
  const full = await page.textContent("#notice-text");
  const [still] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);

  await session.send("Storage.overrideQuotaForOrigin", { origin });
  await page.reload();
  await until("#rate", "completed here");
  await record(2000);
  await until("#take", "Take 1");
  const before = await page.textContent("#take");
  await page.reload();
  await until("#take", "Take 1");
  const after = await page.textContent("#take");
  await until("#rate", "completed here");
  const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
  await download.saveAs(result);

  // A second one; the first is named, shown, cut and kept so; the second is deleted.
  const row = (number) => page.locator("#take-list li").nth(number);
  await record(1500);
  await until("#take", "Take 2");
  const names = await page.locator("#take-list input").evaluateAll((fields) => fields.map(({ value }) => value));
  await page.click("#takes");
  await row(0).locator("input").fill("Walk");
  await row(0).locator("button").first().click();
  await until("#source", "Walk");
  await page.click("#play"); // which stops it
  await page.evaluate(() => {
    const scrub = document.getElementById("scrub");
    scrub.value = String(Number(scrub.max) / 2);
    scrub.dispatchEvent(new Event("input"));
  });
  await page.waitForTimeout(400);
  await page.click("#cut-before");
  await row(1).locator("button").last().click();
  await page.screenshot({ path: `${result}.png` });
  await until("#take", "Walk");
  const cut = await page.textContent("#take");
  const [part] = await Promise.all([page.waitForEvent("download"), page.click("#save-bvh")]);
  await part.saveAs(`${result}.part.bvh`);
  await page.reload();
  await until("#take", "Walk");
  const kept = { take: await page.textContent("#take"), count: await page.locator("#take-list li").count() };
  const named = part.suggestedFilename();
  return { before, after, full, still: still.suggestedFilename(), names, cut, kept, named };
}).finally(() => site.close());
