/** The page of a server: its input is watched, parts are switched off, a broken line comes back: node watch.mjs ADDRESS PICTURE */

import { scenario } from "../page.mjs";

const [address, picture] = process.argv.slice(2);
await scenario({ viewport: { width: 520, height: 420 } }, async (page) => {
  await page.goto(address);
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const text = (id) => page.textContent(id);
  await until("#source", "server's own input");
  await until("#summary", "from the truth");
  await until("#summary", "3 points");
  await page.waitForTimeout(1500);
  const before = { source: await text("#source"), summary: await text("#summary") };
  await page.screenshot({ path: picture });
  await page.dispatchEvent("#settings", "click");
  for (const name of ["Left hand", "Right hand"])
    await page.locator("#parts label", { hasText: name }).locator("input").dispatchEvent("click");
  await page.waitForTimeout(4000);
  const headOnly = await text("#summary");
  await page.dispatchEvent("#open-performance", "click");
  await until("#rate", "completed here");
  await until("#source", "performance");
  return { before, headOnly, notice: await page.isVisible("#notice") };
});
