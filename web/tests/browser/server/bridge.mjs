/** The page alone sends its body to a bridge: node bridge.mjs FOLDER ADDRESS, of a running `bodysense serve --bridge` */

import { scenario, serveFolder } from "../page.mjs";

const [folder, address] = process.argv.slice(2);
const site = await serveFolder(folder);
const refused = /127\.0\.0\.1:\d+\/ws.* failed|^Failed to load resource/; // by servers that answer with a refusal, or not at all
await scenario({ viewport: { width: 900, height: 420 }, expected: refused }, async (page) => {
  await page.routeWebSocket(/nobody/, (socket) => socket.close({ code: 1006 }));
  await page.goto(`${site.address}#bridge=${encodeURIComponent(address)}`);
  const until = (id, part) =>
    page.waitForFunction(([where, what]) => document.querySelector(where).textContent.includes(what), [id, part], {
      polling: 100,
    });
  const send = () => page.dispatchEvent("#bridge-send", "click");
  const hint = () => page.textContent("#bridge-hint");
  await until("#rate", "completed here");
  await page.dispatchEvent("#settings", "click");
  const before = { address: await page.inputValue("#bridge"), hint: (await hint()).trim() };
  await send();
  await until("#bridge-hint", "sent there");
  await page.waitForTimeout(2000);
  const sending = { hint: await hint(), button: await page.textContent("#bridge-send") };
  // Somebody else watches, by the link that the page names.
  const watcher = await page.context().newPage();
  await watcher.goto(/https?:.*$/.exec(sending.hint)[0]);
  const isSeen = () => /cm expected/.test(document.querySelector("#summary").textContent);
  await watcher.waitForFunction(isSeen, null, { polling: 100 });
  await watcher.waitForTimeout(2000);
  const watched = await watcher.textContent("#source");
  await watcher.close();
  await send();
  const after = { hint: (await hint()).trim(), button: await page.textContent("#bridge-send") };
  await page.fill("#bridge", "not an address");
  await send();
  await until("#notice-text", "no address");
  const wrong = await page.textContent("#notice-text");
  await page.fill("#bridge", address.replace(/token=.*/, "token=wrong"));
  await send();
  await until("#notice-text", "not to this token");
  const token = { notice: await page.textContent("#notice-text"), button: await page.textContent("#bridge-send") };
  await page.fill("#bridge", "ws://127.0.0.1:59999/?token=nobody");
  await send();
  await until("#bridge-hint", "keeps trying");
  return { before, sending, watched, after, wrong, token, gone: await hint() };
}).finally(() => site.close());
