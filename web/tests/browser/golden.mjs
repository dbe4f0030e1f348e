/** The golden takes through the page's own worker: node golden.mjs FOLDER TAKES RESULT */

import { readFileSync, writeFileSync } from "node:fs";
import { scenario, serveFolder } from "./page.mjs";

const [folder, takes, result] = process.argv.slice(2);
const site = await serveFolder(folder);
await scenario({ serviceWorkers: "block" }, async (page) => {
  await page.goto(site.address);
  await page.route("**/golden.bin", (route) => route.fulfill({ body: readFileSync(takes) }));
  const bodies = await page.evaluate(run);
  writeFileSync(result, Buffer.from(bodies.bytes, "base64"));
  return { frames: bodies.frames, p50: bodies.p50, p99: bodies.p99 };
});
site.close();

async function run() {
  const buffer = await (await fetch("golden.bin")).arrayBuffer();
  const line = new Uint8Array(buffer).indexOf(10);
  const { points, frames, height } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 0, line)));
  const worker = new Worker("worker.js", { type: "module" });
  const heard = () => new Promise((done) => (worker.onmessage = ({ data }) => done(data)));
  const ask = (message) => {
    const answer = heard();
    worker.postMessage(message);
    return answer;
  };
  const opened = await ask({ type: "open", base: document.baseURI });
  if (opened.type !== "opened") throw new Error(opened.reason);
  const person = { height: height === null ? null : { value: height, deviation: 0.001 }, lengths: [] };
  worker.postMessage({ type: "start", person, settings: { floor: 0, holdFeet: true } });
  const [parts, spent] = [[], []];
  let at = line + 1;
  const floats = (count, Kind = Float32Array) => {
    const values = new Kind(buffer.slice(at, at + count * Kind.BYTES_PER_ELEMENT));
    at += count * Kind.BYTES_PER_ELEMENT;
    return values;
  };
  for (const count of frames) {
    const P = points.length;
    const time = floats(count, Float64Array);
    const [position, rotation, accuracy] = [floats(3 * P * count), floats(4 * P * count), floats(P * count)];
    const [placed, turned] = [floats(P * count, Uint8Array), floats(P * count, Uint8Array)];
    for (let frame = 0; frame < count; frame++) {
      const rows = points.flatMap((name, point) => {
        const k = frame * P + point;
        if (!placed[k] && !turned[k]) return [];
        const row = { name, accuracy: accuracy[k] };
        row.position = placed[k] ? [...position.subarray(3 * k, 3 * k + 3)] : null;
        row.rotation = turned[k] ? [...rotation.subarray(4 * k, 4 * k + 4)] : null;
        return [row];
      });
      const answer = await ask({ type: "step", id: frame, observation: { time: time[frame], points: rows } });
      if (answer.type !== "completed") throw new Error(answer.reason);
      parts.push(answer.body.placed.position, answer.body.rotation);
      spent.push(answer.milliseconds);
    }
  }
  spent.sort((a, b) => a - b);
  const bytes = new Uint8Array(await new Blob(parts).arrayBuffer());
  let text = "";
  for (let k = 0; k < bytes.length; k += 32768) text += String.fromCharCode(...bytes.subarray(k, k + 32768));
  const quantile = (share) => spent[Math.floor(share * (spent.length - 1))];
  return { bytes: btoa(text), frames: spent.length, p50: quantile(0.5), p99: quantile(0.99) };
}
