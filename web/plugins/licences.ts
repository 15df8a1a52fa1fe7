/** The licences of everything that is built into the page, as one text beside it. */

import { existsSync, readdirSync, readFileSync } from 'node:fs'
import { dirname, join } from 'node:path'
import type { Plugin } from 'vite'

export const LICENCES = 'licences.txt'
const ALLOWED = new Set([
  'MIT',
  'ISC',
  'BSD-2-Clause',
  'BSD-3-Clause',
  '0BSD',
  'Zlib',
  'Apache-2.0',
  '(MIT OR Apache-2.0)',
])
const RULE = '-'.repeat(78)

interface Package {
  name: string
  version: string
  license?: string
  author?: string | { name: string }
  homepage?: string
  repository?: string | { url: string }
  dependencies?: Record<string, string>
}

/** Folders of the packages that the page and its workers take code from. */
const bundled = new Set<string>()

/** Notes what a build takes in; the workers' builds need it, too. */
export function collectPackages(): Plugin {
  return {
    name: 'collect-packages',
    generateBundle(_, bundle) {
      for (const output of Object.values(bundle)) {
        if (output.type !== 'chunk') continue
        for (const id of Object.keys(output.modules)) {
          const folder = packageFolder(id)
          if (folder) bundled.add(folder)
        }
      }
    },
  }
}

/** Writes `licences.txt`; a package without a text, or with a licence not yet looked at, ends the build. */
export function writeLicences(root: string): Plugin {
  return {
    name: 'write-licences',
    generateBundle: {
      order: 'post',
      handler() {
        const all = withDependencies(bundled, root)
        if (!all.length) this.error('no package was seen in the bundle; its licences cannot be told')
        const head = "Software of others in the operator's page of AGRIBOT, with its licences.\n"
        const source = [head, ...all.map((folder) => section(folder, root))].join('\n')
        this.emitFile({ type: 'asset', fileName: LICENCES, source })
      },
    },
  }
}

function packageFolder(id: string): string | null {
  const found = /^\0?(.*\/node_modules\/(?:@[^/]+\/)?[^/?]+)\//.exec(id)
  return found ? (found[1] as string) : null
}

function read(folder: string): Package {
  return JSON.parse(readFileSync(join(folder, 'package.json'), 'utf8')) as Package
}

/** Also what these packages name as theirs: some come as one file with others built into it. */
function withDependencies(folders: Iterable<string>, root: string): string[] {
  const all = new Set(folders)
  for (const folder of all) {
    for (const name of Object.keys(read(folder).dependencies ?? {})) {
      if (!name.startsWith('@types/')) all.add(resolve(name, folder, root))
    }
  }
  return [...all].sort()
}

function resolve(name: string, from: string, root: string): string {
  for (let folder = from; folder.startsWith(root); folder = dirname(folder)) {
    const found = join(folder, 'node_modules', name)
    if (existsSync(join(found, 'package.json'))) return found
  }
  throw new Error(`${name}, which ${from} needs, is not installed; run npm ci`)
}

function section(folder: string, root: string): string {
  const about = read(folder)
  if (!ALLOWED.has(about.license ?? '')) {
    throw new Error(`${about.name}: licence ${about.license ?? 'not told'} is none of ${[...ALLOWED].join(', ')}`)
  }
  const where =
    about.homepage ?? (typeof about.repository === 'string' ? about.repository : about.repository?.url) ?? ''
  return [
    RULE,
    `${about.name} ${about.version} (${about.license})`,
    where,
    '',
    text(folder, about, root).trim(),
    '',
  ].join('\n')
}

function text(folder: string, about: Package, root: string): string {
  const files = readdirSync(folder)
    .filter((name) => /^(licen[sc]e|copying|notice)(\.|-|$)/i.test(name))
    .sort()
  if (files.length) return files.map((name) => readFileSync(join(folder, name), 'utf8').trim()).join('\n\n')
  if (about.license === 'Apache-2.0') return readFileSync(join(root, '..', 'LICENSE'), 'utf8')
  const author = typeof about.author === 'string' ? about.author : about.author?.name
  if (about.license === 'MIT' && author) return `Copyright (c) ${author}\n\n${MIT}`
  throw new Error(`${about.name} has no text of its licence`)
}

const MIT = `Permission is hereby granted, free of charge, to any person obtaining a copy
of this software and associated documentation files (the "Software"), to deal
in the Software without restriction, including without limitation the rights
to use, copy, modify, merge, publish, distribute, sublicense, and/or sell
copies of the Software, and to permit persons to whom the Software is
furnished to do so, subject to the following conditions:

The above copyright notice and this permission notice shall be included in all
copies or substantial portions of the Software.

THE SOFTWARE IS PROVIDED "AS IS", WITHOUT WARRANTY OF ANY KIND, EXPRESS OR
IMPLIED, INCLUDING BUT NOT LIMITED TO THE WARRANTIES OF MERCHANTABILITY,
FITNESS FOR A PARTICULAR PURPOSE AND NONINFRINGEMENT. IN NO EVENT SHALL THE
AUTHORS OR COPYRIGHT HOLDERS BE LIABLE FOR ANY CLAIM, DAMAGES OR OTHER
LIABILITY, WHETHER IN AN ACTION OF CONTRACT, TORT OR OTHERWISE, ARISING FROM,
OUT OF OR IN CONNECTION WITH THE SOFTWARE OR THE USE OR OTHER DEALINGS IN THE
SOFTWARE.`
