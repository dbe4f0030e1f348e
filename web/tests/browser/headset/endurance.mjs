/** Minutes in an emulated headset at 72 Hz: node endurance.mjs FOLDER SECONDS
 *
 * Steps are timed in the worker. Where Linux counts it, the worker's thread is asked how long it computed and how long
 * it waited for a processor: what it waited is the machine's business. A headset has no other work, so where the system
 * lets it the page's process comes before all other work (`isFirst`). Memory is what garbage collection leaves of page and
 * worker, and of the process, from when the timeline is full.
 */

import { spawnSync } from "node:child_process";
import { readdirSync, readFileSync } from "node:fs";
import { wearEmulated } from "../emulated_headset.mjs";
import { scenario, serveFolder } from "../page.mjs";

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
  await page.dispatchEvent("#open-headset", "click");
  await says("#source", "headset");
  // A headset shows no page while it is in VR.
  await page.evaluate(() => (document.documentElement.style.display = "none"));
  await page.waitForTimeout(5000); // WebAssembly is compiled better while it runs
  const browser = await page.context().browser().newBrowserCDPSession();
  const { processInfo } = await browser.send("SystemInfo.getProcessInfo");
  const [renderer] = processInfo.filter(({ type }) => type === "renderer").sort((a, b) => b.cpuTime - a.cpuTime);
  const isFirst = spawnSync("chrt", ["--all-tasks", "--rr", "--pid", "1", String(renderer.id)]).status === 0;
  const began = Date.now();
  const passed = () => (Date.now() - began) / 1000;
  const atFirst = scheduled(renderer.id);
  await page.evaluate(() => [steps, frames].forEach((times) => (times.count = 0)));
  await page.waitForTimeout(1000 * WARM_UP);
  const held = [];
  const looked = async () => held.push({ at: passed(), ...(await memory(page, renderer.id)) });
  for (await looked(); passed() < seconds; await looked())
    await page.waitForTimeout(1000 * Math.min(LOOK, Math.max(seconds - passed(), 0)));
  const [end, early, late] = [passed(), held[0], held.at(-1)];
  const atLast = scheduled(renderer.id);
  const times = await page.evaluate(() => {
    const taken = ({ values, count }) => [...values.subarray(0, count)];
    return { steps: taken(steps), frames: taken(frames) };
  });
  const growth = Object.fromEntries(["heap", "process"].map((key) => [key, late[key] / early[key] - 1]));
  const perStep = (key) => atLast && (atLast[key] - atFirst[key]) / times.steps.length;
  return {
    seconds: end,
    isFirst,
    rate: times.steps.length / end,
    ...quantiles(times.steps),
    thread: atLast && { computed: perStep("computed"), waited: perStep("waited") }, // ms a step
    page: { ...quantiles(times.frames), rate: times.frames.length / end }, // ms that a frame took on the page's own thread
    ...{ held, growth, summary: await page.textContent("#summary") },
  };
});
site.close();

function quantiles(times) {
  const sorted = [...times].sort((a, b) => a - b);
  const quantile = (share) => sorted[Math.floor(share * (sorted.length - 1))];
  return { p50: quantile(0.5), p99: quantile(0.99), worst: sorted.at(-1) };
}

/** A display of so many Hz, a wearer who moves, and how long each step took in the worker, each frame in the page (ms). */
function timed(rate) {
  const room = () => ({ values: new Float32Array(100_000), count: 0 }); // that is held from the beginning
  window.steps = room();
  window.frames = room();
  const count = (times, milliseconds) => (times.values[times.count++] = milliseconds);
  let due = performance.now();
  window.requestAnimationFrame = (call) => {
    const now = performance.now();
    due += (1000 / rate) * Math.max(Math.ceil(((now - due) * rate) / 1000), 1); // a display does not wait
    return setTimeout(() => {
      const began = performance.now();
      const time = began / 1000;
      const swing = Math.sin(2 * time);
      device.position.set(0.2 * Math.sin(0.7 * time), 1.6 + 0.05 * swing, 0.2 * Math.cos(0.5 * time));
      device.controllers.left.position.set(-0.25, 1.2 + 0.3 * swing, -0.35 + 0.1 * Math.sin(3 * time));
      device.controllers.right.position.set(0.25, 1.2 - 0.3 * swing, -0.35);
      call(began);
      count(frames, performance.now() - began);
    }, due - now);
  };
  window.cancelAnimationFrame = (id) => clearTimeout(id);
  const { prototype } = WebGL2RenderingContext; // a headset has a graphics card for this; here is none
  for (const name of ["drawElements", "drawArrays", "drawElementsInstanced", "drawArraysInstanced", "clear"])
    prototype[name] = () => undefined;
  const [ask, known] = [prototype.getParameter, new Map()];
  prototype.getParameter = function (name) {
    if (!known.has(name)) known.set(name, ask.call(this, name)); // iwer asks every frame, which waits for the drawing
    return known.get(name);
  };
  const Plain = window.Worker;
  window.Worker = class extends Plain {
    constructor(...made) {
      super(...made);
      this.addEventListener("message", ({ data }) => data.type === "completed" && count(steps, data.milliseconds));
    }
  };
}

/** MB: what the page's heap holds, and what its process takes. */
async function memory(page, renderer) {
  const session = await page.context().newCDPSession(page);
  for (let round = 0; round < 3; round++) await session.send("HeapProfiler.collectGarbage");
  const { usedSize } = await session.send("Runtime.getHeapUsage");
  await session.detach();
  const resident = /^Rss:\s+(\d+)/m.exec(readFileSync(`/proc/${renderer}/smaps_rollup`, "utf8"))[1];
  return { heap: usedSize / 1e6, process: Number(resident) / 1e3 };
}

/** ms that the thread of the busiest worker computed, and waited for a processor; null where it is not counted. */
function scheduled(renderer) {
  try {
    const tasks = `/proc/${renderer}/task`;
    const found = readdirSync(tasks)
      .filter((id) => readFileSync(`${tasks}/${id}/comm`, "utf8").startsWith("DedicatedWorker"))
      .map((id) => readFileSync(`${tasks}/${id}/schedstat`, "utf8").split(" ").map(Number))
      .sort((a, b) => b[0] - a[0])[0];
    return { computed: found[0] / 1e6, waited: found[1] / 1e6 };
  } catch {
    return null;
  }
}
