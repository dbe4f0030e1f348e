/** The page watching the replay of a running server: node watch.mjs ADDRESS PICTURE */

import { scenario } from "./page.mjs";

const [address, picture] = process.argv.slice(2);
await scenario({ colorScheme: "light" }, async (page) => {
  const begin = Date.now();
  await page.goto(address);
  const until = (check) => page.waitForFunction(check, null, { polling: 100 });
  await until(() => document.querySelector("#rate").textContent.includes("Hz"));
  const usableAfter = Date.now() - begin;
  await until(
    () => document.querySelector("#status").textContent === "Connected · head, left wrist, right wrist measured",
  );
  await page.waitForTimeout(1500);
  const text = (id) => page.textContent(id);
  const before = { status: await text("#status"), shown: await text("#shown"), rate: await text("#rate") };
  await page.screenshot({ path: picture });
  await page.getByRole("button", { name: "Head only" }).click();
  await until(() => document.querySelector("#status").textContent === "Connected · head measured");
  await page.waitForTimeout(2500);
  const off = await page.$$eval("#sensors input", (boxes) => boxes.filter((box) => !box.checked).length);
  const headOnly = { status: await text("#status"), shown: await text("#shown"), off };
  await page.screenshot({ path: picture.replace(".png", "_head.png") });
  return { usableAfter, before, headOnly, notice: await page.isVisible("#notice") };
});
