import { defineConfig } from "vite";

// Everything is a file of the daemon's own below assets/: nothing inlined, so that the page works under `default-src 'self'`.
export default defineConfig({
  base: "./",
  build: {
    target: "es2022",
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
    chunkSizeWarningLimit: 1000, // three.js is one chunk
    emptyOutDir: true,
    rollupOptions: { output: { manualChunks: { three: ["three"] } } },
  },
  worker: { format: "es" },
  // `npm run dev` shows changes at once, with the sessions of a daemon that runs beside it.
  server: {
    proxy: { "/live": { target: process.env["RUSTLE_HTTP"] ?? "http://127.0.0.1:7393", ws: true, changeOrigin: true, rewriteWsOrigin: true } },
  },
});
