/** A line that breaks: the page comes back by itself and asks for the session that it had: node resume.mjs FOLDER */

import { fakeServer, WELCOME } from "../fake_server.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [folder] = process.argv.slice(2);

const site = await serveFolder(folder);
await scenario({ viewport: { width: 500, height: 400 } }, async (page) => {
  let breaks = 2;
  const heard = await fakeServer(page, (socket, message) => {
    if (message.type !== "hello" || message.watch !== "replay" || breaks === 0) return false;
    breaks -= 1;
    socket.send(JSON.stringify(WELCOME));
    setTimeout(() => socket.close({ code: 1006 }), 300);
    return true;
  });
  await page.goto(site.address);
  await page.waitForFunction(() => document.querySelector("#source").textContent.includes("server's own input"), null, {
    polling: 100,
  });
  const hellos = heard.filter(({ type }) => type === "hello").map(({ watch, resume }) => ({ watch, resume }));
  await page.waitForSelector("#notice", { state: "hidden" });
  return { hellos, source: await page.textContent("#source") };
});
site.close();
