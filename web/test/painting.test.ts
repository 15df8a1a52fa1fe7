import assert from 'node:assert/strict'
import { test } from 'node:test'
import { type Classes, fill, History, type Pieces, SOIL, stroke, tint } from '../src/label/painting.ts'

const CROP = 1

function soil(width: number, height: number): Classes {
  return { width, height, data: new Uint8Array(width * height).fill(SOIL) }
}

function count(classes: Classes, kind: number): number {
  return classes.data.filter((value) => value === kind).length
}

test('a click paints a disc, a stroke what a disc passes over', () => {
  const classes = soil(100, 80)
  stroke(classes, { x: 50, y: 40 }, { x: 50, y: 40 }, 10, CROP)
  assert.ok(Math.abs(count(classes, CROP) - Math.PI * 100) < 15)
  stroke(classes, { x: 50, y: 40 }, { x: 80, y: 40 }, 10, CROP)
  assert.ok(Math.abs(count(classes, CROP) - (Math.PI * 100 + 600)) < 25)
})

test('a stroke over the edge stays in its rows', () => {
  const classes = soil(20, 10)
  stroke(classes, { x: 30, y: 5 }, { x: 18, y: 5 }, 3, CROP)
  for (let y = 0; y < 10; y++) assert.equal(classes.data[y * 20], SOIL)
  assert.equal(classes.data[5 * 20 + 19], CROP)
})

test('a fill takes one superpixel, also where these are coarser than the picture', () => {
  const pieces: Pieces = { width: 2, height: 1, data: new Uint16Array([7, 9]) }
  const classes = soil(10, 4)
  assert.equal(fill(classes, pieces, { x: 11, y: 1 }, CROP), null)
  fill(classes, pieces, { x: 7.5, y: 1.5 }, CROP)
  for (let i = 0; i < 40; i++) assert.equal(classes.data[i], i % 10 >= 5 ? CROP : SOIL)
})

test('undo and redo bring back what was there, stroke by stroke', () => {
  const classes = soil(30, 30)
  const history = new History()
  const states = [classes.data.slice()]
  for (const x of [8, 14, 20]) {
    history.begin(classes)
    history.touch(stroke(classes, { x, y: 10 }, { x, y: 20 }, 4, CROP))
    assert.ok(history.end(classes))
    states.push(classes.data.slice())
  }
  for (const before of [2, 1, 0]) {
    history.undo(classes)
    assert.deepEqual(classes.data, states[before])
  }
  assert.equal(history.undo(classes), null)
  for (const after of [1, 2, 3]) {
    history.redo(classes)
    assert.deepEqual(classes.data, states[after])
  }
})

test('a stroke that changes nothing is no step', () => {
  const classes = soil(30, 30)
  const history = new History()
  history.begin(classes)
  history.touch(stroke(classes, { x: 10, y: 10 }, { x: 20, y: 20 }, 3, SOIL))
  assert.equal(history.end(classes), false)
  assert.equal(history.canUndo, false)
})

test('soil is clear, plants are tinted and their outlines full', () => {
  const classes = soil(9, 9)
  stroke(classes, { x: 4.5, y: 4.5 }, { x: 4.5, y: 4.5 }, 2, CROP)
  const pixels = tint(classes, { left: 0, top: 0, right: 9, bottom: 9 })
  const alpha = (x: number, y: number): number => pixels[4 * (y * 9 + x) + 3] as number
  assert.equal(alpha(0, 0), 0)
  assert.equal(alpha(2, 4), 255)
  assert.ok(alpha(4, 4) > 0 && alpha(4, 4) < 255)
})
