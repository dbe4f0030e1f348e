import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { gzipSync } from "node:zlib";
import { defineConfig, type Plugin } from "vite";

const RUNTIME = "ort-wasm-simd-threaded.wasm";

/** ONNX Runtime's WebAssembly goes out packed: a host that does not compress sends 3.7 MB of it and not 14. */
function packedRuntime(): Plugin {
  return {
    name: "packed-runtime",
    apply: "build",
    generateBundle(_, bundle) {
      for (const [name, file] of Object.entries(bundle)) if (file.fileName.endsWith(".wasm")) delete bundle[name];
      const entry = createRequire(import.meta.url).resolve("onnxruntime-web/wasm");
      const source = gzipSync(readFileSync(join(dirname(entry), RUNTIME)), { level: 9 });
      this.emitFile({ type: "asset", fileName: "runtime.wasm.gz", source });
    },
  };
}

const names = {
  entryFileNames: "[name].js",
  chunkFileNames: "[name].js",
  assetFileNames: "[name][extname]",
};

// The built page is package data of bodysense.serve: names without hashes, so that a rebuild changes files in place.
export default defineConfig({
  base: "./",
  plugins: [packedRuntime()],
  worker: { format: "es", plugins: () => [packedRuntime()], rolldownOptions: { output: names } },
  build: {
    outDir: "../src/bodysense/serve/page",
    emptyOutDir: true,
    target: "es2022",
    modulePreload: { polyfill: false },
    license: { fileName: "licenses.md" },
    chunkSizeWarningLimit: 800,
    rolldownOptions: { output: names },
  },
  server: { proxy: { "/ws": { target: "ws://127.0.0.1:8765", ws: true } } },
});
