import assert from 'node:assert/strict'
import { test } from 'node:test'
import { readSensors, readStartList, tellSince, tellWhy } from '../src/screens/gate-card.ts'
import type { ShownGate, State } from '../src/wire.ts'

const gate = (state: ShownGate['state'], reason = ''): ShownGate => ({ state, since_s: 20, reason })
const shown = (more: object): State =>
  ({
    mode: 'mission',
    t_s: 32.4,
    stop: '',
    reason: '',
    gate: null,
    checks: [],
    doubts: [],
    ...more,
  }) as unknown as State

test('the reason of the gate is shown once, and not at all beside the banner of a stop', () => {
  const jump = 'GNSS jumped by 2.01 m; look where the robot stands'
  assert.equal(tellWhy(shown({ reason: jump, gate: gate('held') })), jump)
  assert.equal(tellWhy(shown({ gate: gate('held', jump) })), jump)
  const stopped = {
    stop: 'the left wheel stands: 0.1 rad/s',
    stop_kinds: ['wheel left'],
    reason: 'clear the stop to go on: the left wheel stands: 0.2 rad/s',
    reason_kinds: ['stop to clear', 'wheel left'],
    gate: gate('stopped'),
  }
  assert.equal(tellWhy(shown(stopped)), '')
  const replayed = shown({ ...stopped, mode: 'replay' })
  assert.match(tellWhy(replayed), /^Clear the stop to go on/, 'its banner is about the robot itself')
  const other = { ...stopped, reason_kinds: ['stop to clear', 'wheel right'] }
  assert.match(tellWhy(shown(other)), /^Clear the stop to go on/, 'another wheel')
})

test('a robot that drives says where it is, not why it drives', () => {
  const mission = { reason: '', leg: 'row 3' }
  assert.equal(tellWhy(shown({ mission, gate: gate('driving', 'over: no position') })), 'Row 3')
  assert.equal(tellWhy(shown({ mission, reason: 'creeps', gate: gate('slowed') })), 'Creeps')
})

test('since when is shown as precisely as matters', () => {
  assert.deepEqual(
    [tellSince(32.4, 20), tellSince(200, 20), tellSince(8000, 20), tellSince(5, null), tellSince(5, 9)],
    ['for 12 s', 'for 3 min', 'for 2 h 13 min', '', 'for 0 s'],
  )
})

test('the list before the start is open while it holds the robot, and has what is wrong first', () => {
  const checks = [
    ['clock', '', '', [], []],
    ['position', 'no position yet', '', ['no position'], []],
    ['camera', '', '', [], []],
  ]
  const open = readStartList(shown({ checks, gate: gate('checking') }))
  assert.deepEqual([open?.isOpen, open?.isGood, open?.title], [true, false, 'Before the start: 2 of 3 good'])
  assert.deepEqual(
    open?.items.map(({ name, isGood, reason }) => [name, isGood, reason]),
    [
      ['position', false, 'No position yet'],
      ['clock', true, ''],
      ['camera', true, ''],
    ],
  )
  const waiting = { ...gate('checking', 'still no position'), reason_kinds: ['awaited', 'no position'] }
  const told = readStartList(shown({ checks, gate: waiting }))
  assert.equal(told?.items[0].reason, '', 'it stands above')
  assert.equal(readStartList(shown({ checks, gate: gate('stopped') }))?.isOpen, true)
  for (const state of ['driving', 'slowed', 'held', 'by hand'] as const) {
    assert.equal(readStartList(shown({ checks, gate: gate(state) }))?.isOpen, false, state)
  }
  const good = readStartList(shown({ checks: [['clock', '', '', [], []]], gate: gate('standby') }))
  assert.deepEqual([good?.isOpen, good?.title], [false, 'Before the start: all 1 good'])
  assert.equal(readStartList(shown({ gate: gate('standby') })), null, 'nothing was gone through')
})

test('what is to be known of a good item stands with it, after what is wrong', () => {
  const checks = [
    ['clock', '', '', [], []],
    ['contactor', '', 'none: only the red button', [], ['no contactor']],
    ['field', 'outside', '', ['outside'], []],
  ]
  const list = readStartList(shown({ checks, gate: gate('checking') }))
  assert.deepEqual(list?.items, [
    { name: 'field', isGood: false, reason: 'Outside' },
    { name: 'contactor', isGood: true, reason: 'None: only the red button' },
    { name: 'clock', isGood: true, reason: '' },
  ])
  assert.equal(list?.title, 'Before the start: 2 of 3 good')
})

test('sensors that are not fine come first, with since when and a reason that stands nowhere else', () => {
  const doubts = [
    { sensor: 'gnss', state: 'contradicted', since_s: 30, reason: 'GNSS jumped 2.02 m', reason_kinds: ['jump'] },
    { sensor: 'camera', state: 'late', since_s: null, reason: 'pictures 0.8 s old' },
  ]
  const [gnss, camera, ...fine] = readSensors(
    shown({ doubts, reason: 'GNSS jumped 2.01 m; resume to believe it', reason_kinds: ['jump'] }),
    true,
  )
  assert.deepEqual(gnss, { text: 'GNSS contradicted', tone: 'bad', since: 'for 2 s', reason: '' })
  assert.deepEqual(camera, { text: 'Camera late', tone: 'warn', since: '', reason: 'Pictures 0.8 s old' })
  assert.deepEqual(
    fine.map(({ text }) => text),
    ['Compass', 'Gyro', 'Wheels', 'Clock'],
  )
  assert.equal(
    readSensors(shown({ checks: [['clock', '', '', [], []]] }), true).length,
    5,
    'a run without a camera has no line',
  )
  assert.equal(readSensors(shown({ checks: [['camera', '', '', [], []]] }), true).length, 6)
  const bare = readSensors(shown({ checks: [['clock', '', '', [], []]] }), false)
  assert.deepEqual(
    bare.map(({ text }) => text),
    ['GNSS', 'Gyro', 'Wheels', 'Clock'],
    'a robot without a magnetometer has no line of a compass',
  )
})
