import assert from 'node:assert/strict'
import { test } from 'node:test'
import { KEEP_S, SignalBuffer, toCsv, valueRange } from '../src/plots/buffer.ts'
import { Trajectory, joinRobot } from '../src/trajectory.ts'

test('the window holds the samples of its length, up to its end', () => {
  const buffer = new SignalBuffer(['v'], ['m/s'])
  for (let t = 0; t <= 20; t++) buffer.extend([[t, 10 * t]])
  assert.deepEqual(buffer.window([0], 3), [
    [17, 18, 19, 20],
    [170, 180, 190, 200],
  ])
  assert.deepEqual(buffer.window([0], 2, 10), [
    [8, 9, 10],
    [80, 90, 100],
  ])
})

test('samples of the wrong width are refused, and a jump back in time starts afresh', () => {
  const buffer = new SignalBuffer(['v'], [''])
  assert.equal(buffer.extend([[1, 2, 3]]), false)
  buffer.extend([
    [5, 1],
    [6, 1],
    [2, 9],
  ])
  assert.deepEqual(buffer.window([0], 100), [[2], [9]])
})

test('ten minutes are kept and no more', () => {
  const buffer = new SignalBuffer(['v'], [''])
  for (let t = 0; t < 3000; t++) buffer.extend([[t, t]])
  assert.ok(buffer.length <= KEEP_S * 1.1 + 2, String(buffer.length))
  assert.equal(buffer.window([0], KEEP_S)[0].length, KEEP_S + 1)
})

test('a CSV quotes a name with a comma and leaves a missing value empty', () => {
  assert.equal(
    toCsv(
      ['t', 'a,b'],
      [
        [1, 2],
        [null, 3],
      ],
    ),
    't,"a,b"\n1,\n2,3\n',
  )
})

test('trajectory points that came twice are taken once', () => {
  const trajectory = new Trajectory()
  trajectory.restart(0, [
    [0, 0],
    [1, 0],
  ])
  trajectory.extend(1, [
    [1, 0],
    [2, 0],
  ])
  assert.deepEqual(trajectory.pieces, [
    [
      [0, 0],
      [1, 0],
      [2, 0],
    ],
  ])
})

test('a gap in the trajectory is not joined by a line', () => {
  const trajectory = new Trajectory()
  trajectory.restart(0, [
    [0, 0],
    [1, 0],
  ])
  trajectory.extend(9, [
    [9, 0],
    [10, 0],
  ])
  assert.equal(trajectory.pieces.length, 2)
  assert.equal(trajectory.next, 11)
})

test('a signal that stands still lies in the middle of its axis, a moving one has some room', () => {
  assert.deepEqual(valueRange(null, 0, 0), [-0.1, 0.1])
  assert.deepEqual(valueRange(null, 20, 20), [18, 22])
  assert.deepEqual(valueRange(null, 0, 100), [-8, 108])
})

test('the track ends at the robot where it is near, and is not drawn to one that is ahead of it', () => {
  assert.deepEqual(joinRobot([[0, 0]], [0, 0.3]), [
    [0, 0],
    [0, 0.3],
  ])
  assert.deepEqual(joinRobot([[0, 0]], [0, 12]), [[0, 0]])
})
