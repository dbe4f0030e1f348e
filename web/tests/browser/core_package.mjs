/** A recording through the installed package in Chromium: node core_package.mjs PROJECT RECORDING RESULT */

import { writeFileSync } from "node:fs";
import { scenario, serveFolder } from "./page.mjs";

const [project, recording, result] = process.argv.slice(2);
const site = await serveFolder(project);
await scenario({}, async (page) => {
  await page.goto(site.address);
  const done = await page.evaluate(async (name) => {
    const { run } = await import(new URL("run.js", document.baseURI).href);
    const weights = await (await fetch("node_modules/@bodysense/core/completion.safetensors")).arrayBuffer();
    return run(await (await fetch(name)).json(), new Uint8Array(weights));
  }, recording);
  writeFileSync(result, JSON.stringify(done));
  return done.times;
});
site.close();
