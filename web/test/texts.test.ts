import assert from 'node:assert/strict'
import { readdirSync, readFileSync } from 'node:fs'
import { join } from 'node:path'
import { after, test } from 'node:test'
import { bytes, metres } from '../src/format.ts'
import { decimals, findLanguage, many, say, TABLES, useLanguage } from '../src/say.ts'
import { en } from '../src/texts/en.ts'
import type { Forms, Key } from '../src/texts/types.ts'

after(() => useLanguage('en'))

const KEYS = Object.keys(en) as Key[]
const formsOf = (text: string | Forms): string[] => (typeof text === 'string' ? [text] : Object.values(text))
const namesIn = (text: string): string[] => [...text.matchAll(/\{(\w+)\}/g)].map(([, name]) => name).sort()

/** The code of the page without its texts, where it runs in `web/`. */
function readCode(): string {
  const files = readdirSync('src', { recursive: true, encoding: 'utf8' })
  const code = files.filter((name) => name.endsWith('.ts') && !name.startsWith('texts'))
  return code.map((name) => readFileSync(join('src', name), 'utf8')).join('\n')
}

test('every text is shown somewhere', () => {
  const quoted = new Set([...readCode().matchAll(/'(\w+)'/g)].map(([, name]) => name))
  assert.deepEqual(
    KEYS.filter((key) => !quoted.has(key)),
    [],
  )
})

const { en: _, ...others } = TABLES
for (const [language, load] of Object.entries(others)) {
  const { texts } = await load()
  test(`a text has the same values in ${language}, in the singular too`, () => {
    const values = (text: string | Forms): string[][] => formsOf(text).map(namesIn)
    assert.deepEqual(
      KEYS.filter((key) => JSON.stringify(values(texts[key])) !== JSON.stringify(values(en[key]))),
      [],
    )
  })

  test(`no sentence is the English one in ${language}`, () => {
    const isSentence = (text: string): boolean => (text.match(/\b[a-z]{2,}\b/g) ?? []).length > 2
    assert.deepEqual(
      KEYS.filter((key) => formsOf(en[key]).some((text) => isSentence(text) && formsOf(texts[key]).includes(text))),
      [],
    )
  })
}

test('the language is the one that was chosen, else the first of the browser’s that is known', () => {
  assert.equal(findLanguage('de', ['en-GB']), 'de')
  assert.equal(findLanguage(null, ['fr-FR', 'de-AT', 'en']), 'de')
  assert.equal(findLanguage(null, ['hi-IN', 'en-IN']), 'hi')
  assert.equal(findLanguage('xx', ['fr']), 'en')
})

test('English says one and several', () =>
  assert.deepEqual(
    [say('countRow', { count: 1 }), say('countRow', { count: 3 }), say('fieldSaved', { name: 'Oak {hill}' })],
    ['1 row', '3 rows', 'Field “Oak {hill}” saved on the robot.'],
  ))

test('German has its own plural, decimals and thousands', async () => {
  await useLanguage('de')
  assert.deepEqual([say('countRow', { count: 1 }), say('countRow', { count: 0 })], ['1 Reihe', '0 Reihen'])
  assert.deepEqual([decimals(1.25, 2), metres(12.34), bytes(1_840_000)], ['1,25', '12,3 m', '1,8 MB'])
  assert.equal(many(12345), '12.345')
  await useLanguage('en')
  assert.equal(metres(12.34), '12.3 m')
})

test('Hindi has its own plural, Latin digits and lakhs', async () => {
  await useLanguage('hi')
  assert.deepEqual([say('countRow', { count: 1 }), say('countRow', { count: 3 })], ['1 कतार', '3 कतारें'])
  assert.deepEqual([metres(12.34), many(1_234_567)], ['12.3 m', '12,34,567'])
})
