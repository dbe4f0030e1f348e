/** Working without a network: after the first visit every file comes from this browser. */

/** The description of a folder of the page (`page.json`). */
export interface About {
  readonly server: boolean; // a server of bodysense is behind it
  readonly webcam: boolean; // MediaPipe's files are in it
  readonly version: string;
}

/** Keep the page's files, unless a server delivers the page: its files may be newer. */
export function workOffline({ server }: About, base: string): void {
  if (server || !("serviceWorker" in navigator)) return;
  // Without it the page works as long as there is a network.
  const keep = () => void navigator.serviceWorker.register(new URL("sw.js", base)).catch(() => undefined);
  if (document.readyState === "complete") keep();
  else addEventListener("load", keep);
}
