import { defineConfig } from 'vite'

// The server of `agribot ui` is the only origin; `npm run dev` borrows it for live reload.
const server = process.env.AGRIBOT_UI ?? 'http://127.0.0.1:8080'

export default defineConfig({
  base: './',
  build: {
    outDir: '../src/agribot/ui/page',
    emptyOutDir: true,
    target: 'es2022',
    chunkSizeWarningLimit: 1200,
    assetsInlineLimit: 0,
    modulePreload: { polyfill: false },
  },
  worker: { format: 'es' },
  server: {
    proxy: {
      '/api': server,
      '/robot': server,
      '/tiles': server,
      '/ws': { target: server, ws: true },
    },
  },
})
