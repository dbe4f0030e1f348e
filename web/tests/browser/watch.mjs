/** The page of a server: its input is watched, parts are switched off, a broken line comes back: node watch.mjs ADDRESS PICTURE */

import { scenario } from "./page.mjs";

const [address, picture] = process.argv.slice(2);
await scenario({ viewport: { width: 520, height: 420 } }, async (page) => {
  await page.goto(address);
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const text = (id) => page.textContent(id);
  await until("#source", "server's own input");
  await until("#shown", "from the truth");
  await until("#shown", "3 points");
  await page.waitForTimeout(1500);
  const before = { source: await text("#source"), shown: await text("#shown") };
  await page.screenshot({ path: picture });
  await page.dispatchEvent("#settings", "click");
  for (const name of ["Left hand", "Right hand"])
    await page.locator("#parts label", { hasText: name }).locator("input").dispatchEvent("click");
  await page.waitForTimeout(4000);
  const headOnly = await text("#shown");
  await page.dispatchEvent("#door-performance", "click");
  await until("#rate", "completed here");
  await until("#source", "performance");
  return { before, headOnly, notice: await page.isVisible("#notice") };
});
