/** A line that breaks: the page comes back by itself and asks for the session that it had: node resume.mjs */

import { fakeServer, WELCOME } from "./fake_server.mjs";
import { scenario, servePage } from "./page.mjs";

const site = await servePage();
await scenario({ viewport: { width: 500, height: 400 } }, async (page) => {
  let breaks = 2;
  const heard = await fakeServer(page, (socket, said) => {
    if (said.type !== "hello" || said.watch !== "replay" || breaks === 0) return false;
    breaks -= 1;
    socket.send(JSON.stringify(WELCOME));
    setTimeout(() => socket.close({ code: 1006 }), 300);
    return true;
  });
  await page.goto(site.address);
  await page.waitForFunction(() => document.querySelector("#rate").textContent.includes("Hz"), null, { polling: 100 });
  const hellos = heard.filter(({ type }) => type === "hello").map(({ watch, resume }) => ({ watch, resume }));
  return { hellos, status: await page.textContent("#status"), notice: await page.isVisible("#notice") };
});
site.close();
