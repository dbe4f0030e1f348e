/** What axe-core finds on pages of the built docs, light and dark: node docs.mjs FOLDER PAGE… */

import { createRequire } from "node:module";
import { launched, serveFolder } from "../page.mjs";

const [folder, ...pages] = process.argv.slice(2);
const AXE = createRequire(import.meta.url).resolve("axe-core/axe.min.js");
const site = await serveFolder(folder);
const faults = {};

// A browser each: the docs keep the first colours.
for (const [colorScheme, scheme] of Object.entries({ light: "default", dark: "slate" }))
  await launched([], { colorScheme, reducedMotion: "reduce", isCalm: false }, async (page) => {
    for (const name of pages) {
      await page.goto(`${site.address}${name}`, { waitUntil: "load" });
      await page.waitForFunction((wanted) => document.body.dataset.mdColorScheme === wanted, scheme, { polling: 100 });
      await page.addScriptTag({ path: AXE });
      faults[`${name} ${colorScheme}`] = await page.evaluate(async () => {
        const { violations } = await axe.run();
        return violations
          .filter(({ impact }) => impact === "serious" || impact === "critical")
          .map(({ id, nodes }) => [id, nodes.length, nodes[0].html.slice(0, 200)]);
      });
    }
  });
console.log(JSON.stringify({ faults, errors: [], read: [] }));
site.close();
