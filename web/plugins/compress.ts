/** A compressed copy beside every file of the page, so that the robot's computer need not make one. */

import { readFileSync, writeFileSync } from 'node:fs'
import { join } from 'node:path'
import { gzipSync } from 'node:zlib'
import type { Plugin } from 'vite'

const TEXT = /\.(js|css|html|svg|txt|json)$/
const SMALLEST_BYTES = 1000

export function compress(): Plugin {
  return {
    name: 'compress',
    writeBundle(options, bundle) {
      for (const name of Object.keys(bundle)) {
        const file = join(options.dir ?? '', name)
        const data = TEXT.test(name) ? readFileSync(file) : Buffer.alloc(0)
        if (data.length >= SMALLEST_BYTES) writeFileSync(`${file}.gz`, gzipSync(data, { level: 9 }))
      }
    },
  }
}
