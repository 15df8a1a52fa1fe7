import assert from 'node:assert/strict'
import { test } from 'node:test'
import { passes } from '../src/weed-filter.ts'
import type { WeedFilter } from '../src/weed-filter.ts'
import type { Weed } from '../src/wire.ts'

const ALL: WeedFilter = { weeds: true, crop: true, treated: true, open: true, confidence: 0, withinS: null }

function plant(id: number, changed: Partial<Weed>): Weed {
  return { id, plant: 0, confidence: 0.9, last_seen_s: 100, treated_s: null, ...changed } as Weed
}

const PLANTS = [
  plant(1, {}),
  plant(2, { plant: 1 }),
  plant(3, { confidence: 0.6 }),
  plant(4, { treated_s: 90 }),
  plant(5, { last_seen_s: 30 }),
]

function left(filter: Partial<WeedFilter>, nowS = 110): number[] {
  return PLANTS.filter((weed) => passes(weed, { ...ALL, ...filter }, nowS)).map(({ id }) => id)
}

test('each choice of the filter leaves the plants that it says', () => {
  assert.deepEqual(left({}), [1, 2, 3, 4, 5])
  assert.deepEqual(left({ crop: false }), [1, 3, 4, 5])
  assert.deepEqual(left({ weeds: false }), [2])
  assert.deepEqual(left({ confidence: 0.8 }), [1, 2, 4, 5])
  assert.deepEqual(left({ open: false }), [4])
  assert.deepEqual(left({ treated: false }), [1, 2, 3, 5])
  assert.deepEqual(left({ crop: false, confidence: 0.8, open: false }), [4])
})

test('the minute in which a plant was seen goes on with the time', () => {
  assert.deepEqual(left({ withinS: 60 }, 110), [1, 2, 3, 4])
  assert.deepEqual(left({ withinS: 60 }, 1110), [])
})
