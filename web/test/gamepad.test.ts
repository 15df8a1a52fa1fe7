import assert from 'node:assert/strict'
import { test } from 'node:test'
import type { Pad } from '../src/teleop/gamepad.ts'
import { assignmentOf, choosePad, PadAssigner, parseAssignment, readPad } from '../src/teleop/gamepad.ts'

const buttons = (count: number, ...pressed: number[]): Pad['buttons'] =>
  Array.from({ length: count }, (_, i) => ({ pressed: pressed.includes(i) }))

function pad(changes: Partial<Pad> = {}): Pad {
  return { id: 'pad', mapping: 'standard', connected: true, axes: [0, 0, 0, 0], buttons: buttons(17), ...changes }
}

// An Xbox pad as evdev orders it: the triggers, axes 2 and 5, rest at -1.
const RESTING = [0.02, 0, -1, 0, 0, -1, 0, 0]
const unknown = (axes: number[], ...pressed: number[]): Pad =>
  pad({ id: 'x', mapping: '', axes, buttons: buttons(11, ...pressed) })

const moved = (axis: number, value: number): number[] => RESTING.map((at, i) => (i === axis ? value : at))

test('a standard pad drives while a shoulder button is held', () => {
  const held = pad({ axes: [0, -1, -1, 0], buttons: buttons(17, 4) })
  const standard = assignmentOf(held, null)
  assert.ok(standard)
  assert.deepEqual(readPad(held, standard), { forward: 1, turn: 1 })
  assert.equal(readPad(pad({ axes: [0, -1, -1, 0] }), standard), null)
})

test('a pad of another layout drives nothing before its axes were assigned', () => {
  for (const axes of [RESTING, [0, 0, 1, 0], [0.004, 0.004, 3.28571]])
    assert.equal(assignmentOf(unknown(axes, 4), null), null)
})

test('values beyond their range and values that are not numbers do not drive faster', () => {
  const standard = assignmentOf(pad(), null)
  assert.ok(standard)
  const wild = pad({ axes: [0, -3.28571, Number.NaN, 0], buttons: buttons(17, 5) })
  assert.deepEqual(readPad(wild, standard), { forward: 1, turn: 0 })
})

test('a device without buttons or axes hides no pad, and a known pad comes first', () => {
  const keyboard = pad({ id: 'keys', axes: [], buttons: [] })
  assert.equal(choosePad([null, keyboard, unknown(RESTING), pad()])?.id, 'pad')
  assert.equal(choosePad([keyboard, unknown(RESTING)])?.id, 'x')
  assert.equal(choosePad([keyboard, null]), null)
})

function show(assigner: PadAssigner, ...states: Pad[]): ReturnType<PadAssigner['take']> {
  let found: ReturnType<PadAssigner['take']> = null
  for (const state of states) found = assigner.take(state)
  return found
}

test('what was shown step by step drives, with the signs that were shown', () => {
  const assigner = new PadAssigner()
  const rest = unknown(RESTING)
  assert.match(assigner.text, /Let go of all/)
  show(assigner, ...Array.from({ length: 12 }, () => rest))
  assert.match(assigner.text, /forward/)
  show(assigner, unknown(moved(2, 1)), rest) // a trigger is no stick
  assert.match(assigner.text, /forward/)
  show(assigner, unknown(moved(1, -1)), rest)
  show(assigner, unknown(moved(1, -1)), rest) // the axis is taken
  assert.match(assigner.text, /left/)
  show(assigner, unknown(moved(3, -0.9)), rest)
  const found = show(assigner, unknown(RESTING, 6))
  assert.deepEqual(found, { forward: { axis: 1, sign: -1 }, turn: { axis: 3, sign: -1 }, deadMan: [6] })
  assert.ok(found)
  assert.deepEqual(readPad(unknown(moved(1, -1), 6), found), { forward: 1, turn: 0 })
  assert.equal(readPad(unknown(moved(1, -1), 4), found), null)
})

test('sticks that are held while resting values are taken are waited for', () => {
  const assigner = new PadAssigner()
  show(assigner, ...Array.from({ length: 12 }, (_, i) => unknown(moved(1, -i / 12))))
  assert.match(assigner.text, /Let go of all/)
})

test('an assignment is kept as text, and nothing else is taken for one', () => {
  const kept = { forward: { axis: 1, sign: -1 }, turn: { axis: 3, sign: 1 }, deadMan: [6] }
  assert.deepEqual(parseAssignment(JSON.stringify(kept)), kept)
  const wrong = [null, '', '{', '[]', '{"forward": 1}', JSON.stringify({ ...kept, deadMan: [] })]
  for (const text of wrong) assert.equal(parseAssignment(text), null)
})
