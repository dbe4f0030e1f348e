/** What goes wrong, and what the page says of it: node faults.mjs FOLDER */

import { scenario, serveFolder } from "../page.mjs";

const [folder] = process.argv.slice(2);
const site = await serveFolder(folder);

/** A camera of which MediaPipe sees nobody. */
const NOBODY = `postMessage({ type: "opened" });
  onmessage = ({ data: { picture: image, milliseconds } }) =>
    image && postMessage({ type: "seen", world: [], picture: [], hands: [], image, milliseconds }, [image]);`;

await scenario({ viewport: { width: 500, height: 400 }, serviceWorkers: "block" }, async (page) => {
  const about = { server: false, webcam: true, version: "fake", files: [] };
  await page.route("**/page.json", (route) => route.fulfill({ json: about }));
  await page.route("**/camera_worker.js", (route) => route.fulfill({ body: NOBODY, contentType: "text/javascript" }));
  await page.goto(site.address);
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const notices = {};
  const keep = async (name, part) => {
    await until("#notice-text", part);
    notices[name] = await page.textContent("#notice-text");
  };
  await until("#rate", "completed here");

  for (const name of ["NotAllowedError", "NotFoundError", "NotReadableError", "OverconstrainedError"]) {
    await page.evaluate((reason) => {
      navigator.mediaDevices.getUserMedia = () => Promise.reject(new DOMException("no", reason));
    }, name);
    await page.dispatchEvent("#open-webcam", "click");
    const parts = { NotAllowedError: "refused", NotFoundError: "No webcam", NotReadableError: "another program" };
    await keep(name, parts[name] ?? name);
  }
  await page.evaluate(() => {
    const canvas = document.createElement("canvas");
    window.light = 0; // of 255
    const draw = () => {
      const context = canvas.getContext("2d");
      context.fillStyle = `rgb(${light} ${light} ${light})`;
      context.fillRect(0, 0, canvas.width, canvas.height);
      context.fillStyle = "black"; // so that pictures differ
      context.fillRect(0, 0, Math.random() * 9, 9);
    };
    setInterval(draw, 50);
    navigator.mediaDevices.getUserMedia = async () => (window.stream = canvas.captureStream());
  });
  await page.dispatchEvent("#open-webcam", "click");
  await keep("covered", "picture is black");
  await page.evaluate(() => (window.light = 120));
  await keep("nobody", "Nobody");
  await page.evaluate(() => stream.getTracks()[0].dispatchEvent(new Event("ended")));
  await keep("unplugged", "unplugged");
  await page.evaluate(() => navigator.mediaDevices.dispatchEvent(new Event("devicechange")));
  await page.waitForSelector("#notice", { state: "hidden" }); // it goes on
  await keep("again", "Nobody");
  await page.dispatchEvent("#open-performance", "click");
  await until("#source", "performance");

  const drop = (name, content) =>
    page.setInputFiles("#file", { name, mimeType: "application/octet-stream", buffer: Buffer.from(content) });
  const header = '{"format": "bodysense-recording-1", "points": ["head"]}';
  await drop("cut.jsonl", `${header}\n{"time": 0, "position": {"head": [0, 1.6`);
  await keep("cut", "cut.jsonl");
  await drop("empty.bvh", "");
  await keep("empty", "empty.bvh");
  await drop("numbers.npz", "PK is no archive");
  await keep("numbers", "numbers.npz");
  await drop("model.glb", "glTF");
  await keep("model", "model.glb");
  await until("#summary", "from the truth"); // and the performance goes on

  await page.evaluate(() => {
    const context = document.getElementById("view").getContext("webgl2");
    window.loss = context.getExtension("WEBGL_lose_context");
    loss.loseContext();
  });
  await keep("drawing", "graphics");
  await page.evaluate(() => loss.restoreContext());
  await page.waitForSelector("#notice", { state: "hidden" });

  await page.route("**/completion.safetensors.gz", (route) => route.fulfill({ body: "not packed" }));
  await page.reload();
  await keep("damaged", "damaged");
  await until("#summary", "tracked"); // the motion itself is shown

  await page.unroute("**/completion.safetensors.gz");
  await page.addInitScript(() => {
    const refuse = () => {
      throw new DOMException("no page may store anything", "SecurityError");
    };
    for (const name of ["localStorage", "indexedDB"]) Object.defineProperty(window, name, { get: refuse });
  });
  await page.reload();
  await until("#rate", "completed here"); // where nothing may be stored everything else works
  await page.dispatchEvent("#theme", "click");
  await keep("settingsRefused", "settings count");
  await page.dispatchEvent("#record", "click");
  await page.waitForTimeout(1500);
  await page.dispatchEvent("#record", "click");
  await keep("takeRefused", "your take is kept");
  return { notices };
}).finally(() => site.close());
