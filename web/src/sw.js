/* The service worker: files of the page come from this browser after the first visit; page.json says which they are,
 * and of which version: a newer one is fetched whole, then takes the old one's place. */

const ABOUT = "page.json";

async function about() {
  const response = await fetch(ABOUT, { cache: "no-store" });
  if (!response.ok) throw new Error(`${ABOUT}: ${response.status}`);
  return [response.clone(), await response.json()];
}

async function keep() {
  const [response, { version, files }] = await about();
  const name = `bodysense-${version}`;
  if (await caches.has(name)) return;
  const cache = await caches.open(name);
  try {
    await cache.addAll(["./", ...files]);
    await cache.put(ABOUT, response);
  } catch (error) {
    await caches.delete(name); // a cache is whole or not there
    throw error;
  }
  for (const other of await caches.keys()) {
    if (other.startsWith("bodysense-") && other !== name) await caches.delete(other);
  }
}

addEventListener("install", (event) => event.waitUntil(keep().then(() => skipWaiting())));
addEventListener("activate", (event) => event.waitUntil(clients.claim()));
addEventListener("fetch", (event) => {
  const { method, url } = event.request;
  if (method !== "GET" || !url.startsWith(registration.scope)) return;
  if (new URL(url).pathname.endsWith(`/${ABOUT}`)) {
    // Asked anew at every visit, which also brings a newer version for the next one.
    event.waitUntil(keep().catch(() => undefined));
    event.respondWith(fetch(event.request).catch(() => caches.match(event.request, { ignoreSearch: true })));
    return;
  }
  event.respondWith(
    caches.match(event.request, { ignoreSearch: true }).then((kept) => kept ?? keepLater(event.request)),
  );
});

/** What is not in the list (MediaPipe's files) is kept when it was fetched once. */
async function keepLater(request) {
  const response = await fetch(request);
  const [name] = (await caches.keys()).filter((key) => key.startsWith("bodysense-"));
  if (response.ok && name) await (await caches.open(name)).put(request, response.clone());
  return response;
}
