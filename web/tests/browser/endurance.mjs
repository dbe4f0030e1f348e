/** Minutes in an emulated headset at 72 Hz: node endurance.mjs FOLDER SECONDS
 *
 * Steps are timed in the worker; memory is what garbage collection leaves of page and worker, and of the process.
 */

import { readFileSync } from "node:fs";
import { wearEmulated } from "./emulated_headset.mjs";
import { scenario, serveFolder } from "./page.mjs";

const [folder, duration] = process.argv.slice(2);
const seconds = Number(duration);
const site = await serveFolder(folder);
const RATE = 72; // Hz
const WARM_UP = Math.min(240, 0.4 * seconds); // s: the timeline is full, and proportions are settled
const LOOK = 60; // s between two looks at the memory

await scenario({ isCalm: false, viewport: { width: 300, height: 200 } }, async (page) => {
  await wearEmulated(page);
  await page.addInitScript(timed, RATE);
  await page.goto(site.address);
  const says = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 200,
    });
  await says("#rate", "completed here");
  await page.dispatchEvent("#door-headset", "click");
  await says("#source", "headset");
  // A headset shows no page while it is in VR.
  await page.evaluate(() => (document.documentElement.style.display = "none"));
  await page.waitForTimeout(5000); // WebAssembly is compiled better while it runs
  await page.evaluate(() => steps.splice(0));
  const began = Date.now();
  const browser = await page.context().browser().newBrowserCDPSession();
  const passed = () => (Date.now() - began) / 1000;
  await page.waitForTimeout(1000 * WARM_UP);
  const held = [];
  const looked = async () => held.push({ at: passed(), ...(await memory(page, browser)) });
  for (await looked(); passed() < seconds; await looked())
    await page.waitForTimeout(1000 * Math.min(LOOK, Math.max(seconds - passed(), 0)));
  const [end, early, late] = [passed(), held[0], held.at(-1)];
  const steps_ = await page.evaluate(() => steps);
  const sorted = [...steps_].sort((a, b) => a - b);
  const quantile = (share) => sorted[Math.floor(share * (sorted.length - 1))];
  const growth = Object.fromEntries(["heap", "process"].map((key) => [key, late[key] / early[key] - 1]));
  return {
    seconds: end,
    rate: steps_.length / end,
    ...{ p50: quantile(0.5), p99: quantile(0.99), worst: sorted.at(-1) },
    ...{ held, growth, shown: await page.textContent("#shown") },
  };
});
site.close();

/** A display of so many Hz, a wearer who moves, and how long each step took in the worker (ms). */
function timed(rate) {
  window.steps = [];
  let due = 0;
  window.requestAnimationFrame = (call) => {
    due = Math.max(due + 1000 / rate, performance.now());
    return setTimeout(() => {
      const time = performance.now() / 1000;
      const swing = Math.sin(2 * time);
      device.position.set(0.2 * Math.sin(0.7 * time), 1.6 + 0.05 * swing, 0.2 * Math.cos(0.5 * time));
      device.controllers.left.position.set(-0.25, 1.2 + 0.3 * swing, -0.35 + 0.1 * Math.sin(3 * time));
      device.controllers.right.position.set(0.25, 1.2 - 0.3 * swing, -0.35);
      call(performance.now());
    }, due - performance.now());
  };
  window.cancelAnimationFrame = (id) => clearTimeout(id);
  const { prototype } = WebGL2RenderingContext; // a headset has a graphics card for this; here is none
  for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced", "clear"])
    prototype[name] = () => undefined;
  const Plain = window.Worker;
  window.Worker = class extends Plain {
    constructor(...made) {
      super(...made);
      this.addEventListener("message", ({ data }) => data.type === "completed" && steps.push(data.milliseconds));
    }
  };
}

/** MB: what the page's heap holds, and what its process takes. */
async function memory(page, browser) {
  const session = await page.context().newCDPSession(page);
  for (let round = 0; round < 3; round++) await session.send("HeapProfiler.collectGarbage");
  const { usedSize } = await session.send("Runtime.getHeapUsage");
  await session.detach();
  const { processInfo } = await browser.send("SystemInfo.getProcessInfo");
  const sizes = processInfo
    .filter(({ type }) => type === "renderer")
    .map(({ id }) => /^Rss:\s+(\d+)/m.exec(readFileSync(`/proc/${id}/smaps_rollup`, "utf8")));
  const resident = Math.max(...sizes.map((found) => Number(found?.[1] ?? 0)));
  return { heap: usedSize / 1e6, process: resident / 1e3 };
}
