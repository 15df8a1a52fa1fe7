import { defineConfig } from 'vite'
import { compress } from './plugins/compress.ts'
import { collectPackages, writeLicences } from './plugins/licences.ts'

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
    rollupOptions: { input: ['index.html', 'label.html'] },
  },
  plugins: [collectPackages(), writeLicences(import.meta.dirname), compress()],
  worker: { format: 'es', plugins: () => [collectPackages()] },
  server: {
    proxy: {
      '/api': server,
      '/robot': server,
      '/tiles': server,
      '/ws': { target: server, ws: true },
    },
  },
})
