/** What the page says of servers that refuse, break off or talk nonsense: node refusals.mjs FOLDER */

import { fakeServer, WELCOME } from "../fake_server.mjs";
import { scenario, serveFolder } from "../page.mjs";

const [folder] = process.argv.slice(2);

const CASES = {
  refused: (socket) => {
    const reason = "messages of version 1; this server speaks version 2: load its page again, or use its client";
    socket.send(JSON.stringify({ type: "error", reason }));
    socket.close({ code: 1008, reason: "another version" });
  },
  nonsense: (socket) => socket.send("this is not JSON"),
  cut: (socket) => {
    socket.send(JSON.stringify(WELCOME));
    socket.send(Buffer.from([2, 0, 52, 0, 1, 2, 3, 4, 0, 0, 0, 0, 0, 0, 0, 0, 1]));
  },
  gone: (socket) => socket.close({ code: 1006 }),
};

const site = await serveFolder(folder);
await scenario({ viewport: { width: 500, height: 400 } }, async (page) => {
  const notices = {};
  for (const [name, behave] of Object.entries(CASES)) {
    await page.unrouteAll();
    await fakeServer(page, (socket) => {
      behave(socket);
      return true;
    });
    await page.goto(`${site.address}?case=${name}`);
    await page.waitForSelector("#notice:not([hidden])");
    const again = page.getByRole("button", { name: "Connect again" });
    notices[name] = { text: await page.textContent("#notice-text"), canRetry: await again.isVisible() };
  }
  return { notices };
});
site.close();
