import { defineConfig } from "vite";

// The built page is package data of bodysense.serve: names without hashes, so that a rebuild changes files in place.
export default defineConfig({
  base: "./",
  build: {
    outDir: "../src/bodysense/serve/page",
    emptyOutDir: true,
    target: "es2022",
    modulePreload: { polyfill: false },
    license: { fileName: "licenses.md" },
    chunkSizeWarningLimit: 800,
    rolldownOptions: {
      output: {
        entryFileNames: "[name].js",
        chunkFileNames: "[name].js",
        assetFileNames: "[name][extname]",
      },
    },
  },
  server: { proxy: { "/ws": { target: "ws://127.0.0.1:8765", ws: true } } },
});
