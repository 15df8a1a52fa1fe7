import assert from 'node:assert/strict'
import { test } from 'node:test'
import { readFacts, readFix } from '../src/screens/gnss-card.ts'
import type { ReceiverState } from '../src/wire.ts'

const receiver = (more: object): ReceiverState =>
  ({
    quality: 0,
    fix_age_s: 0.2,
    status_age_s: 0,
    std_m: 1,
    rate_hz: 5,
    satellites: [],
    used_count: 0,
    in_view_count: 0,
    hdop: null,
    pdop: null,
    vdop: null,
    correction_age_s: null,
    caster: '',
    caster_state: null,
    device: '',
    line_trouble: '',
    unmeasured: '',
    position_trouble: '',
    unread: [],
    ...more,
  }) as unknown as ReceiverState

test('a place without satellites is named and is no fix', () => {
  assert.equal(readFix(receiver({ unmeasured: 'dead reckoning' })).text, 'Dead reckoning, no satellites')
  assert.deepEqual(readFix(receiver({ unmeasured: 'held' })), { text: 'Held place, no satellites', tone: 'bad' })
  assert.equal(readFix(receiver({ quality: 4 })).text, 'RTK fixed')
})

test('why there is no position stands first, and what is not read at the end', () => {
  const trouble = 'no positions among what it says (ZDA); switch on GGA and RMC'
  const facts = readFacts(receiver({ position_trouble: trouble, unread: ['ZDA', 'PASHR'] }), undefined, 0)
  assert.deepEqual(facts[0], { name: 'No position', text: trouble, tone: 'bad' })
  assert.deepEqual(facts[facts.length - 1], { name: 'Not read', text: 'ZDA, PASHR', tone: 'plain' })
})
