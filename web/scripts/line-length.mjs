/** Names every line of the given folders and files that is too long; what the formatter cannot break it leaves long. */

import { readdirSync, readFileSync, statSync } from 'node:fs'
import { join } from 'node:path'

const LONGEST = 120
const SUFFIXES = /\.(css|html|mjs|ts)$/
/** Texts of the page: a line each, however long. */
const TEXTS = /[\\/]texts[\\/][a-z]{2}\.ts$/

const filesOf = (path) =>
  statSync(path).isDirectory() ? readdirSync(path, { recursive: true }).map((name) => join(path, name)) : [path]

const tooLong = process.argv
  .slice(2)
  .flatMap(filesOf)
  .filter((file) => SUFFIXES.test(file) && !TEXTS.test(file))
  .flatMap((file) =>
    readFileSync(file, 'utf8')
      .split('\n')
      .flatMap((line, i) =>
        line.length > LONGEST ? [`${file}:${i + 1}: ${line.length} characters, at most ${LONGEST}`] : [],
      ),
  )
for (const problem of tooLong) process.stderr.write(`${problem}\n`)
process.exitCode = tooLong.length ? 1 : 0
