import assert from 'node:assert/strict'
import { test } from 'node:test'
import { byPlant } from '../src/map/plant-size.ts'

test('crops are larger than weeds at every zoom, so that they differ by more than colour', () => {
  const sizes = byPlant(['interpolate', ['exponential', 1.6], ['zoom'], 15, 1, 22, 9], [1.5, 14])
  assert.deepEqual(sizes, [
    'interpolate',
    ['exponential', 1.6],
    ['zoom'],
    15,
    ['match', ['get', 'plant'], 0, 1, 1.5],
    22,
    ['match', ['get', 'plant'], 0, 9, 14],
  ])
})
