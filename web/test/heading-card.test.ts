import assert from 'node:assert/strict'
import { test } from 'node:test'
import { findNoHeading, needsWay } from '../src/screens/heading-card.ts'
import type { State } from '../src/wire.ts'

const at = (t_s: number, more: object = {}): State =>
  ({ mode: 'waiting', t_s, pose: null, gnss: { quality: 4 }, yaw_std_rad: Math.PI, ...more }) as unknown as State

test('a robot that has positions and no heading asks for a way driven after 4 s, no sooner', () => {
  const since_s = findNoHeading(at(12), null)
  assert.equal(since_s, 12)
  assert.equal(findNoHeading(at(13), since_s), 12)
  assert.deepEqual(
    [13, 15.9, 16, 60].map((t_s) => needsWay(at(t_s), since_s)),
    [false, false, true, true],
  )
})

test('nothing is asked for where the heading is known, where there is no fix, and in a replay', () => {
  const known = { pose: [0, 0, 0], yaw_std_rad: 0.1 }
  for (const more of [known, { yaw_std_rad: 0.17 }, { gnss: null }, { mode: 'replay' }]) {
    assert.equal(findNoHeading(at(60, more), 12), null)
  }
  assert.equal(needsWay(at(60), null), false)
})
