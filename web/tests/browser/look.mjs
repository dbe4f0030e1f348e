/** Pictures of the page against the fake server: node look.mjs FOLDER */

import { devices } from "playwright-core";
import { fakeServer } from "./fake_server.mjs";
import { scenario, servePage } from "./page.mjs";

const [folder] = process.argv.slice(2);
const site = await servePage();
for (const [name, options] of [
  ["desktop", { colorScheme: "light" }],
  ["phone", { ...devices["Pixel 7"], deviceScaleFactor: 1, colorScheme: "dark" }],
]) {
  await scenario(options, async (page) => {
    await fakeServer(page);
    await page.goto(site.address);
    await page.waitForTimeout(2500);
    await page.screenshot({ path: `${folder}/${name}.png`, fullPage: name === "phone" });
    return { name, status: await page.textContent("#status") };
  });
}
site.close();
