import assert from 'node:assert/strict'
import { test } from 'node:test'
import { Store } from '../src/store.ts'
import type { Snapshot, State, Vec2, WeedRow } from '../src/wire.ts'

const weed = (id: number): WeedRow => [id, 0, 1, 2, 0.02, 0.9, 0.001, 4, 1, 2, null, '']

function snapshot(epoch: number, source: string, name: string, xy: Vec2[], ids: number[]): Snapshot {
  return {
    kind: 'snapshot',
    epoch,
    source,
    name,
    trace: { kind: 'trace', epoch, first: 0, points_map_m: xy },
    weeds: { kind: 'weeds', epoch, set: ids.map(weed), gone: [] },
    path: { kind: 'path', epoch, first: 0, points_map_m: [], rows: [] },
    events: { kind: 'events', epoch, events: [] },
    signals: { names: ['v'], units: ['m/s'] },
  }
}

const state = (epoch: number, t: number, more: Partial<State> = {}): State =>
  ({
    kind: 'state',
    epoch,
    tick: t,
    t_s: t,
    mono_ms: t,
    stop: '',
    mode: 'mission',
    signals: [[t, 1]],
    ...more,
  }) as State

function live(): Store {
  const store = new Store()
  store.setLinked(true)
  store.accept(
    snapshot(
      1,
      'sim',
      '',
      [
        [0, 0],
        [1, 0],
      ],
      [1, 2, 3],
    ),
    0,
  )
  store.accept(state(1, 10), 0)
  return store
}

test('what belongs to something that is not shown any more is left out', () => {
  const store = live()
  store.accept(snapshot(2, 'replay', 'yesterday', [[9, 9]], [40]), 0)
  assert.equal(store.state, null, 'no state of the robot on the track of the recording')
  store.accept(state(1, 11), 0)
  store.accept({ kind: 'trace', epoch: 1, first: 2, points_map_m: [[2, 0]] }, 0)
  store.accept({ kind: 'weeds', epoch: 1, set: [weed(4)], gone: [] }, 0)
  store.accept(
    { kind: 'events', epoch: 1, events: [{ t_s: 1, level: 'info', source: 'x', state: '', text: 'live' }] },
    0,
  )
  assert.equal(store.state, null)
  assert.deepEqual(store.trajectory.pieces, [[[9, 9]]])
  assert.deepEqual([...store.weeds.keys()], [40])
  assert.deepEqual(store.log, [])
  assert.equal(store.counters.foreign, 4)
  store.accept(
    snapshot(
      1,
      'sim',
      '',
      [
        [0, 0],
        [1, 0],
        [2, 0],
      ],
      [1, 2, 3, 4],
    ),
    0,
  )
  store.accept(state(1, 12), 0)
  assert.deepEqual([...store.weeds.keys()], [1, 2, 3, 4])
  assert.equal(store.trajectory.length, 3)
  assert.equal(store.signals.length, 1, 'the plots begin afresh')
})

test('a change of what is shown is announced, and a line that comes back is no change', () => {
  const store = live()
  const told: string[] = []
  store.on('restart', () => told.push('restart'))
  store.on('channel', ({ name }) => told.push(`channel ${name}`))
  store.setLinked(false)
  store.setLinked(true)
  store.accept(state(1, 13), 0)
  assert.equal(store.state?.t_s, 10, 'nothing counts before the snapshot of the new line')
  store.accept(snapshot(1, 'sim', '', [], []), 0)
  assert.deepEqual(told, [])
  store.accept(snapshot(2, 'replay', 'a', [], []), 0)
  store.accept(snapshot(3, 'replay', 'a', [], []), 0)
  assert.deepEqual(told, ['restart', 'channel a', 'restart'])
})

test('a snapshot that comes in pieces is whole in the end', () => {
  const store = live()
  store.accept(
    {
      kind: 'trace',
      epoch: 1,
      first: 2,
      points_map_m: [
        [2, 0],
        [3, 0],
      ],
    },
    0,
  )
  store.accept(
    {
      kind: 'path',
      epoch: 1,
      first: 0,
      points_map_m: [
        [0, 0],
        [1, 1],
      ],
      rows: [0, 0],
    },
    0,
  )
  store.accept({ kind: 'path', epoch: 1, first: 2, points_map_m: [[2, 2]], rows: [1] }, 0)
  assert.deepEqual(store.path, {
    points_map_m: [
      [0, 0],
      [1, 1],
      [2, 2],
    ],
    rows: [0, 0, 1],
  })
  store.accept({ kind: 'path', epoch: 1, first: 0, points_map_m: [[5, 5]], rows: [0] }, 0)
  assert.deepEqual(store.path, { points_map_m: [[5, 5]], rows: [0] })
  assert.equal(store.trajectory.length, 4)
  assert.equal(store.trajectory.pieces.length, 1)
})

test('a stop that is pressed in a replay is confirmed by the robot, not by the recording', () => {
  const store = live()
  store.accept(snapshot(2, 'replay', 'a', [], []), 0)
  store.stop.press(0)
  store.stop.hear(true)
  store.accept(
    state(2, 1, { stop: 'stopped by somebody then', replay: { name: 'a', t_s: 1, start_s: 0, end_s: 9, speed: 1 } }),
    0,
  )
  assert.equal(store.stop.isPending, true)
  store.accept({ kind: 'live_state', mode: 'stopped', stop: 'stopped by operator 1' }, 0)
  assert.equal(store.stop.isPending, false)
})
