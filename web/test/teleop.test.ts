import assert from 'node:assert/strict'
import { test } from 'node:test'
import { keysInput, padInput, TeleopMachine, withoutDeadZone } from '../src/teleop/machine.ts'

const limits = { speedMps: 0.8, yawRateRadps: 1 }

function armed(): TeleopMachine {
  const machine = new TeleopMachine()
  machine.setArmed(true)
  return machine
}

test('an unarmed machine never commands anything', () => {
  const machine = new TeleopMachine()
  machine.hold('pad', 1, 0)
  assert.equal(machine.tick(limits), null)
})

test('a held input is repeated every tick with growing numbers', () => {
  const machine = armed()
  machine.hold('keys', 1, -1)
  assert.deepEqual(machine.tick(limits), { v: 0.8, w: -1 })
  assert.deepEqual(machine.tick(limits), { v: 0.8, w: -1 })
})

test('letting go gives exactly one zero and then silence', () => {
  const machine = armed()
  machine.hold('pad', 0.5, 0)
  machine.tick(limits)
  machine.release('pad')
  assert.deepEqual(machine.tick(limits), { v: 0, w: 0 })
  assert.equal(machine.tick(limits), null)
})

test('losing the seat while driving gives a zero', () => {
  const machine = armed()
  machine.hold('gamepad', 1, 0)
  machine.tick(limits)
  machine.setArmed(false)
  assert.deepEqual(machine.tick(limits), { v: 0, w: 0 })
})

test('an input held while arming does nothing until it was let go once', () => {
  const machine = new TeleopMachine()
  machine.hold('gamepad', 1, 0)
  machine.setArmed(true)
  machine.hold('gamepad', 1, 0)
  assert.equal(machine.tick(limits), null)
  machine.release('gamepad')
  machine.hold('gamepad', 1, 0)
  assert.equal(machine.tick(limits)?.v, 0.8)
})

test('what is held in vain is known until it is let go', () => {
  const machine = armed()
  machine.hold('pad', 1, 0)
  assert.equal(machine.isHeldInVain, false)
  machine.setArmed(false) // the line was slow
  machine.setArmed(true)
  machine.hold('pad', 1, 0)
  assert.equal(machine.isHeldInVain, true)
  machine.release('pad')
  assert.equal(machine.isHeldInVain, false)
})

test('after leaving the window a stick that is still held does not drive on', () => {
  const machine = armed()
  machine.hold('gamepad', 1, 0)
  machine.tick(limits)
  machine.releaseAll()
  machine.hold('gamepad', 1, 0)
  assert.deepEqual(machine.tick(limits), { v: 0, w: 0 })
  assert.equal(machine.tick(limits), null)
})

test('the pad wins over the keys, and the keys over the gamepad', () => {
  const machine = armed()
  machine.hold('gamepad', -1, 0)
  machine.hold('keys', 0.5, 0)
  machine.hold('pad', 0.25, 0)
  assert.equal(machine.tick(limits)?.v, 0.2)
  machine.release('pad')
  assert.equal(machine.tick(limits)?.v, 0.4)
})

test('no input exceeds the limits, and a broken one is zero', () => {
  const machine = armed()
  machine.hold('gamepad', 7, Number.NaN)
  assert.deepEqual(machine.tick(limits), { v: 0.8, w: 0 })
})

test('opposite keys cancel', () => assert.deepEqual(keysInput(['KeyW', 'ArrowDown', 'KeyA']), { forward: 0, turn: 1 }))

test('the pad gives full input at its edge and no more outside it', () => {
  assert.deepEqual(padInput(0, -50, 50), { forward: 1, turn: -0 })
  const far = padInput(300, 300, 50)
  assert.ok(Math.abs(Math.hypot(far.forward, far.turn) - 1) < 1e-12)
})

test('a stick at rest gives nothing and one at its stop gives everything', () => {
  assert.equal(withoutDeadZone(0.1), 0)
  assert.equal(withoutDeadZone(-1), -1)
})
