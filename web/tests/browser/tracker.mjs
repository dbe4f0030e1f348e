/** A recording through the built page's own worker: node tracker.mjs FOLDER RECORDING RESULT */

import { readFileSync, writeFileSync } from "node:fs";
import { scenario, serveFolder } from "./page.mjs";

const [folder, recording, result] = process.argv.slice(2);
const site = await serveFolder(folder);
await scenario({ serviceWorkers: "block" }, async (page) => {
  const blank = `${site.address}blank.html`; // of the page's host, without the page
  const body = '<link rel="icon" href="data:," />';
  await page.route(blank, (route) => route.fulfill({ body, contentType: "text/html" }));
  await page.goto(blank);
  const bodies = await page.evaluate(complete, JSON.parse(readFileSync(recording, "utf8")));
  writeFileSync(result, JSON.stringify({ bodies }));
  const sorted = bodies.map(({ milliseconds }) => milliseconds).sort((a, b) => a - b);
  const quantile = (share) => sorted[Math.floor(share * (sorted.length - 1))];
  return { frames: bodies.length, p50: quantile(0.5), p99: quantile(0.99) };
}).finally(() => site.close());

/** Frames one after the other, as the page sends them. */
async function complete({ person, settings, frames }) {
  const worker = new Worker(new URL("worker.js", document.baseURI), { type: "module" });
  const next = () =>
    new Promise((resolve, reject) => {
      worker.onmessage = ({ data }) => (data.type === "failed" ? reject(new Error(data.reason)) : resolve(data));
    });
  worker.postMessage({ type: "open", base: document.baseURI });
  await next();
  worker.postMessage({ type: "start", person, holdFeet: settings.holdFeet ?? true });
  const bodies = [];
  for (const [id, observation] of frames.entries()) {
    worker.postMessage({ type: "step", id, observation });
    const { completed, milliseconds } = await next();
    const { body, expected, time, ...arrays } = completed;
    const plain = { ...arrays, confidence: expected, points: body.position, world: body.rotation };
    const listed = Object.fromEntries(Object.entries(plain).map(([name, values]) => [name, [...values]]));
    bodies.push({ ...listed, time, milliseconds });
  }
  worker.terminate();
  return bodies;
}
