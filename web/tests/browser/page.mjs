/** The built page in a headless Chromium, for the scenarios beside this file. */

import { createHash } from "node:crypto";
import { createServer } from "node:http";
import { readFile } from "node:fs/promises";
import { extname, join } from "node:path";
import { chromium } from "playwright-core";

const KINDS = {
  ".html": "text/html",
  ".js": "text/javascript",
  ".css": "text/css",
  ".json": "application/json",
  ".wasm": "application/wasm",
};
const ARGUMENTS = [
  ...["--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking"],
  ...["--disable-component-update", "--disable-sync"],
  "--enable-unsafe-swiftshader",
];

/** Serve a folder, as a static host does that packs nothing: its address, and the bytes that it sent. What a browser has
 * already is not sent again.
 */
export async function serveFolder(folder) {
  let sent = 0;
  const server = createServer((request, response) => {
    const path = new URL(request.url ?? "/", "http://page").pathname;
    const name = (path.endsWith("/") ? `${path}index.html` : path).slice(1);
    readFile(join(folder, name)).then(
      (content) => {
        const tag = `"${createHash("sha256").update(content).digest("base64url")}"`;
        response.setHeader("etag", tag);
        if (request.headers["if-none-match"] === tag) return response.writeHead(304).end();
        sent += content.length;
        return response.setHeader("content-type", KINDS[extname(name)] ?? "application/octet-stream").end(content);
      },
      () => response.writeHead(404).end(),
    );
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  return { address: `http://localhost:${server.address().port}/`, close: () => server.close(), sent: () => sent };
}

/** Run something in a fresh page of a browser of its own; unless `isCalm` is false it draws few pictures. */
export async function launched(more, { isCalm = true, ...options }, run) {
  const browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: [...ARGUMENTS, ...more],
  });
  try {
    const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...options });
    const page = await context.newPage();
    page.setDefaultTimeout(240_000); // ends a wait for what never comes; no test waits for a machine to be quick
    if (process.env.TRACE) trace(page);
    if (isCalm) await page.addInitScript(calm);
    return await run(page);
  } finally {
    await browser.close();
  }
}

/** Run a scenario in a fresh page and print what it returns as JSON, with everything that a person could read meanwhile.
 *
 * Errors of the page fail it, but for `expected`. Where times are taken, nothing is read along.
 */
export async function scenario({ expected = /^$/, ...options }, run, more = []) {
  await launched(more, options, async (page) => {
    const [errors, words] = [[], new Set()];
    if (options.isCalm !== false) {
      await page.exposeFunction("readByPerson", (text) => void words.add(text));
      await page.addInitScript(readAlong);
    }
    page.on("pageerror", (error) => errors.push(String(error)));
    page.on("console", (message) => {
      const isInformation = message.text().startsWith("INFO:"); // TensorFlow Lite says everything on stderr
      const isExpected = isInformation || expected.test(message.text());
      if (message.type() === "error" && !isExpected) errors.push(message.text());
    });
    const result = await run(page).catch(async (error) => {
      const text = await page.innerText("body").catch(() => "");
      throw new Error(
        `${error.message}\nerrors of the page: ${errors.join("; ")}\nthe page reads: ${text.slice(0, 600)}`,
      );
    });
    console.log(JSON.stringify({ ...result, errors, read: [...words] }));
  });
}

/** Few pictures a second: without a graphics card they would leave no time for anything else. */
function calm() {
  const BETWEEN = 150; // ms
  window.requestAnimationFrame = (call) => setTimeout(() => call(performance.now()), BETWEEN);
  window.cancelAnimationFrame = (id) => clearTimeout(id);
}

/** Give every text to `readByPerson` that is or becomes visible, a tooltip, or drawn into a picture; numbers are 0. */
function readAlong() {
  const lines = new Set();
  const add = (text) => {
    const line = text
      .replace(/https?:\/\/\S+/g, "an address")
      .replace(/\d+([.,]\d+)?/g, "0")
      .replace(/\s+/g, " ")
      .trim();
    if (line === "" || lines.has(line)) return;
    lines.add(line);
    void window.readByPerson(line);
  };
  const read = (node) => {
    const element = node instanceof Element ? node : node.parentElement;
    const visible = element?.closest("select") ?? element; // options are not visible, but can be read
    if (!visible?.checkVisibility() || element.closest("script, style")) return;
    if (node instanceof Text) return add(node.data);
    for (const name of ["title", "placeholder", "aria-label", "alt"]) add(element.getAttribute(name) ?? "");
    for (const child of element.childNodes) if (child instanceof Text || child instanceof Element) read(child);
  };
  const watch = new MutationObserver((changes) => {
    for (const { type, target, addedNodes } of changes) type === "childList" ? addedNodes.forEach(read) : read(target);
  });
  watch.observe(document, { subtree: true, childList: true, characterData: true, attributes: true });
  const { fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.fillText = function (text, ...where) {
    add(text);
    return fillText.call(this, text, ...where);
  };
}

/** Say on stderr when each wait of a page was over. */
function trace(page) {
  const [wait, began] = [page.waitForFunction.bind(page), Date.now()];
  page.waitForFunction = async (check, argument, options) => {
    const found = await wait(check, argument, options);
    console.error(`${((Date.now() - began) / 1000).toFixed(1)} s`, argument ?? String(check));
    return found;
  };
}
