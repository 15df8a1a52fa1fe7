import assert from 'node:assert/strict'
import { test } from 'node:test'
import { area, bytes, duration, fixName, fixed, metres, NONE, quantity } from '../src/format.ts'

test('lengths, areas, times and sizes read as people write them', () => {
  assert.deepEqual([metres(0.014), metres(0.34), metres(12.34), metres(1500)], ['1.4 cm', '34 cm', '12.3 m', '1.50 km'])
  assert.deepEqual([area(0.004), area(5), area(25000)], ['40 cm²', '5.0 m²', '2.50 ha'])
  assert.deepEqual([duration(9), duration(125), duration(3725)], ['0:09', '2:05', '1:02:05'])
  assert.deepEqual([bytes(12), bytes(1_840_000), bytes(81_300_000_000)], ['12 B', '1.8 MB', '81.3 GB'])
})

test('what is not known is a dash, never a zero', () => {
  assert.deepEqual([metres(null), fixed(undefined, 2), duration(NaN), bytes(null)], [NONE, NONE, NONE, NONE])
})

test('a name of the code loses its unit', () => {
  assert.deepEqual(
    [quantity('yaw_rate_radps'), quantity('follower.lookahead_m'), quantity('v_mps')],
    ['Yaw rate', 'Lookahead', 'Speed'],
  )
})

test('the receiver’s quality is a word', () =>
  assert.deepEqual([fixName(4), fixName(5), fixName('rtk_fixed'), fixName(0)], ['RTK', 'Float', 'RTK', 'No fix']))
