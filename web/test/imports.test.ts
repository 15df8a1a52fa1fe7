import assert from 'node:assert/strict'
import { readdirSync, readFileSync } from 'node:fs'
import { dirname, join, normalize } from 'node:path'
import { test } from 'node:test'

const IMPORT = /(?:from|import|import\()\s*'(\.{1,2}\/[^']+\.ts)'/g

type Arrows = Map<string, Set<string>>

/** File -> files that it imports, types included; paths from `web/`, where npm runs. */
function importsOf(folder: string): Arrows {
  const files = readdirSync(folder, { recursive: true, encoding: 'utf8' }).filter((name) => name.endsWith('.ts'))
  return new Map(
    files.map((name) => {
      const file = join(folder, name)
      const found = readFileSync(file, 'utf8').matchAll(IMPORT)
      return [file, new Set([...found].map(([, path]) => normalize(join(dirname(file), path))))]
    }),
  )
}

/** The same for folders; files beside `main.ts` belong to none. */
function foldersOf(files: Arrows, top: string): Arrows {
  const arrows: Arrows = new Map()
  for (const [file, imported] of files) {
    const from = dirname(file)
    const to = [...imported].map((path) => dirname(path)).filter((folder) => folder !== from && folder !== top)
    if (from !== top) arrows.set(from, new Set([...(arrows.get(from) ?? []), ...to]))
  }
  return arrows
}

/** One circle as the names along it; empty without a circle. */
function findCircle(arrows: Arrows): string[] {
  const done = new Set<string>()
  const follow = (name: string, way: string[]): string[] => {
    if (way.includes(name)) return [...way.slice(way.indexOf(name)), name]
    if (done.has(name)) return []
    for (const next of arrows.get(name) ?? []) {
      const circle = follow(next, [...way, name])
      if (circle.length) return circle
    }
    done.add(name)
    return []
  }
  for (const name of arrows.keys()) {
    const circle = follow(name, [])
    if (circle.length) return circle
  }
  return []
}

test('a circle is found, however long the way to it is', () => {
  const arrows = new Map([
    ['a', new Set(['b'])],
    ['b', new Set(['c'])],
    ['c', new Set(['d', 'b'])],
  ])
  assert.deepEqual(findCircle(arrows), ['b', 'c', 'b'])
  assert.deepEqual(
    findCircle(
      new Map([
        ['a', new Set(['b', 'c'])],
        ['b', new Set(['c'])],
      ]),
    ),
    [],
  )
})

test('no file of the page imports itself by a detour, not even for its types', () => {
  const files = importsOf('src')
  assert.ok(files.get(normalize('src/map/view.ts'))?.has(normalize('src/displays/displays.ts')))
  assert.deepEqual(findCircle(files), [])
})

test('no two folders of the page import each other, not even by a detour', () => {
  const folders = foldersOf(importsOf('src'), 'src')
  assert.ok(folders.get(normalize('src/map'))?.has(normalize('src/displays')))
  assert.deepEqual(findCircle(folders), [])
})
