/** In Node: node node.mjs RECORDING RESULT [WASM], or node node.mjs --refusals */

import { readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import { refusals, run } from "./run.js";

const weights = readFileSync(createRequire(import.meta.url).resolve("@bodysense/core/completion.safetensors"));
const [recording, result, wasm] = process.argv.slice(2);
if (recording === "--refusals") console.log(JSON.stringify(await refusals(weights)));
else {
  const done = await run(JSON.parse(readFileSync(recording, "utf8")), weights, wasm && readFileSync(wasm));
  writeFileSync(result, JSON.stringify(done));
  console.log(JSON.stringify(done.times));
}
