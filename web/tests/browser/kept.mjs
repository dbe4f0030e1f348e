/** Storage that is full is said, and a take is there after a reload: node kept.mjs FOLDER RESULT.bvh */

import { scenario, serveFolder } from "./page.mjs";

const [folder, result] = process.argv.slice(2);
const site = await serveFolder(folder);
await scenario({ viewport: { width: 900, height: 420 } }, async (page) => {
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
  await until("#take", "The last take");
  const before = await page.textContent("#take");
  await page.reload();
  await until("#take", "Your last take");
  const after = await page.textContent("#take");
  await until("#rate", "completed here");
  const [download] = await Promise.all([page.waitForEvent("download"), page.dispatchEvent("#save-bvh", "click")]);
  await download.saveAs(result);

  return { before, after, full, still: still.suggestedFilename() };
}).finally(() => site.close());
