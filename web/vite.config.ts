import { execFileSync } from "node:child_process";
import { readFileSync } from "node:fs";
import { createRequire } from "node:module";
import { dirname, join } from "node:path";
import { defineConfig, type Plugin } from "vite";

const RUNTIME = "ort-wasm-simd-threaded.wasm";

/** What the workers are made of; the license plugin of the build sees the page's own modules only. */
function workerLicenses(): Plugin {
  return {
    name: "worker-licenses",
    apply: "build",
    generateBundle() {
      const rows = ["onnxruntime-web", "@mediapipe/tasks-vision"].map((name) => {
        const found = join("node_modules", name, "package.json");
        const { version, license } = JSON.parse(readFileSync(found, "utf8")) as { version: string; license: string };
        return `## ${name} - ${version} (${license})\n`;
      });
      this.emitFile({
        type: "asset",
        fileName: "licenses-workers.md",
        source: `# Licenses of the workers\n\n${rows.join("\n")}`,
      });
    },
  };
}

/** ONNX Runtime's WebAssembly is not copied as it is … */
function withoutWasm(): Plugin {
  return {
    name: "without-wasm",
    apply: "build",
    generateBundle(_, bundle) {
      for (const [name, file] of Object.entries(bundle)) if (file.fileName.endsWith(".wasm")) delete bundle[name];
    },
  };
}

/**
 * … but is kept packed, 2.2 MB of 14. Browsers unpack no xz: `bodysense.serve.page_files` gives it to them as
 * runtime.wasm.gz. Node packs no xz either; Python does.
 */
function packedRuntime(): Plugin {
  return {
    name: "packed-runtime",
    apply: "build",
    generateBundle() {
      const entry = createRequire(import.meta.url).resolve("onnxruntime-web/wasm");
      const pack = "import lzma, sys; sys.stdout.buffer.write(lzma.compress(sys.stdin.buffer.read(), preset=9))";
      const input = readFileSync(join(dirname(entry), RUNTIME));
      const source = execFileSync("python3", ["-c", pack], { input, maxBuffer: 2 ** 26 });
      this.emitFile({ type: "asset", fileName: "runtime.wasm.xz", source });
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
  plugins: [withoutWasm(), packedRuntime(), workerLicenses()],
  worker: { format: "es", plugins: () => [withoutWasm()], rolldownOptions: { output: names } },
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
