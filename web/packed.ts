/** A plugin of the build that keeps three.js packed, in two parts: what the first picture draws with, and the rest. */

import { gzipSync } from "node:zlib";
import type { Plugin } from "vite";

const [NAME, MORE] = ["three", "three-more"]; // of the packed chunks
const ENTRY = /<script type="module" crossorigin src="(.*?)"><\/script>/;

/** Files that the first picture needs, and that no module names. */
const FIRST = ["page.json", "default_body.json.gz", "performance.npz"];
const preload = (name: string): string => `<link rel="preload" as="fetch" crossorigin href="./${name}" />`;

/** How a browser gets at it: modules name it, and a map says where it is once it is unpacked. The worker that completes
 * bodies needs neither: it fetches and opens the network in the meantime (`Engine.open`). */
const START = `<link rel="preload" as="script" crossorigin href="$1" />
    ${FIRST.map(preload).join("\n    ")}
    <script>
      const startEngine = () => {
        if (globalThis.engineWorker) return;
        globalThis.engineWorker = new Worker("./worker.js", { type: "module", name: "engine" });
        engineWorker.postMessage({ type: "open", base: document.baseURI });
      };
      requestAnimationFrame(() => setTimeout(startEngine)); // after the first words
      let early = null; // a button pressed before there is a module that hears it
      const keep = ({ target }) => (early = target.closest("button"));
      addEventListener("click", keep);
      const start = () => (removeEventListener("click", keep), early?.click());
      const add = (kind, content) => document.head.append(Object.assign(document.createElement("script"), { type: kind, ...content }));
      const unpacked = (name) =>
        fetch("./" + name + ".js.gz")
          .then(({ body }) => new Response(body.pipeThrough(new DecompressionStream("gzip"))).blob())
          .then((code) => [name, URL.createObjectURL(new Blob([code], { type: "text/javascript" }))]);
      Promise.all(["${NAME}", "${MORE}"].map(unpacked))
        .then((found) => {
          add("importmap", { textContent: JSON.stringify({ imports: Object.fromEntries(found) }) });
          add("module", { src: "$1", onload: start });
        })
        .catch(() => {
          document.getElementById("notice-text").textContent = "A file of this page is damaged or missing; load the page again.";
          document.getElementById("notice").hidden = false;
        });
    </script>`;

/** The chunk's name and its modules, for the build's options; Draco's loader finds its decoder by its own address. */
export const PACKED = [
  { name: NAME, test: /node_modules\/three\/(build|.*(OrbitControls|RoundedBoxGeometry))/ },
  { name: MORE, test: /node_modules\/(three|@pixiv)\/(?!.*DRACO)/ },
];

export function packedThree(): Plugin {
  return {
    name: "packed-three",
    apply: "build",
    enforce: "post",
    generateBundle: {
      order: "post",
      handler(_, bundle) {
        for (const { name } of PACKED) {
          const packed = bundle[`${name}.js`];
          if (packed?.type !== "chunk") return this.error(`${name}.js is missing among the chunks`);
          for (const file of Object.values(bundle))
            if (file.type === "chunk") file.code = file.code.replaceAll(`"./${packed.fileName}"`, `"${name}"`);
        }
        for (const { name } of PACKED) {
          const packed = bundle[`${name}.js`];
          if (packed?.type !== "chunk") continue;
          this.emitFile({ type: "asset", fileName: `${name}.js.gz`, source: gzipSync(packed.code, { level: 9 }) });
          delete bundle[packed.fileName];
        }
        for (const file of Object.values(bundle))
          if (file.fileName.endsWith(".html") && file.type === "asset")
            file.source = String(file.source).replace(ENTRY, START);
      },
    },
  };
}
