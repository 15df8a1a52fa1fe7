import assert from 'node:assert/strict'
import { test } from 'node:test'
import { Areas, type AreaTool } from '../src/label/areas.ts'
import { Drawing } from '../src/label/drawing.ts'
import { type Classes, CROP, IGNORED, type Pieces, SOIL, WEED } from '../src/label/painting.ts'
import { namePlants, renameAll } from '../src/label/plants.ts'

const LETTERS: Record<string, number> = { '.': SOIL, w: WEED, c: CROP, i: IGNORED }

function read(...rows: string[]): Classes {
  const data = Uint8Array.from([...rows.join('')].map((letter) => LETTERS[letter] as number))
  return { width: (rows[0] as string).length, height: rows.length, data }
}

function number(...rows: string[]): Pieces {
  return {
    width: (rows[0] as string).length,
    height: rows.length,
    data: Uint16Array.from([...rows.join('')].map(Number)),
  }
}

function show({ width, data }: Classes): string[] {
  const letters = [...data].map((kind) => Object.keys(LETTERS).find((one) => LETTERS[one] === kind)).join('')
  return letters.match(new RegExp(`.{${width}}`, 'g')) ?? []
}

test('a click names all leaves of a plant, those of two names and those apart included', () => {
  const classes = read('ww.c.ww', 'wc.c.ww', '.......', 'iw.....')
  const plants = number('1101022', '1101022', '0000000', '1100000')
  const box = namePlants(classes, plants, { x: 0.5, y: 0.5 }, { x: 0.5, y: 0.5 }, CROP)
  assert.deepEqual(show(classes), ['cc.c.ww', 'cc.c.ww', '.......', 'ic.....'])
  assert.deepEqual(box, { left: 0, top: 0, right: 4, bottom: 4 })
})

test('vegetation of no plant that the network knows is named as far as it is connected', () => {
  const classes = read('ww..w', '..w.w', '....w')
  const plants = number('00000', '00001', '00001')
  namePlants(classes, plants, { x: 0, y: 0 }, { x: 0, y: 0 }, CROP)
  assert.deepEqual(show(classes), ['cc..w', '..c.w', '....w'])
})

test('a drag names every plant that it crosses, and a click on soil or outside names none', () => {
  const classes = read('w.w.w', '.....')
  const none = number('00000', '00000')
  assert.equal(namePlants(classes, none, { x: 1.5, y: 0.5 }, { x: 1.5, y: 0.5 }, CROP), null)
  assert.equal(namePlants(classes, none, { x: -3, y: 0.5 }, { x: -2, y: 0.5 }, CROP), null)
  namePlants(classes, none, { x: 0.5, y: 0.5 }, { x: 2.6, y: 0.5 }, CROP)
  assert.deepEqual(show(classes), ['c.c.w', '.....'])
})

test('all weed becomes crop at once, and nothing else changes', () => {
  const classes = read('w.c', 'iw.')
  assert.deepEqual(renameAll(classes, WEED, CROP), { left: 0, top: 0, right: 2, bottom: 2 })
  assert.deepEqual(show(classes), ['c.c', 'ic.'])
  assert.equal(renameAll(classes, WEED, CROP), null)
})

/** A drawing whose superpixels and plants come when the test gives them. */
function draw(classes: Classes) {
  const given = new Map<AreaTool, { give: (pieces: Pieces) => void; refuse: (error: Error) => void }>()
  const areas = new Areas((tool) => new Promise((give, refuse) => given.set(tool, { give, refuse })))
  let steps = 0
  const count = (): void => {
    steps += 1
  }
  const drawing = new Drawing(classes, areas, () => undefined, count)
  return { drawing, given, countSteps: () => steps }
}

const HALVES = number('1122', '1122')
const click = (drawing: Drawing, tool: 'fill' | 'brush' | 'rename', kind: number, x: number): void => {
  drawing.begin(tool, kind, 0.6, { x, y: 0.5 })
  drawing.end()
}

test('strokes that are made while superpixels are computed are drawn in their order', async () => {
  const { drawing, given, countSteps } = draw(read('....', '....'))
  click(drawing, 'fill', CROP, 0.5)
  click(drawing, 'brush', WEED, 0.5) // over the superpixel, which is not here yet
  assert.deepEqual(show(drawing.classes), ['....', '....'])
  assert.equal(drawing.waitingCount, 2)
  const settled = drawing.settle()
  given.get('fill')?.give(HALVES)
  await settled
  assert.deepEqual(show(drawing.classes), ['wc..', 'cc..'])
  assert.deepEqual([drawing.waitingCount, countSteps()], [0, 2])
  drawing.undo()
  assert.deepEqual(show(drawing.classes), ['cc..', 'cc..'])
})

test('a stroke that waits is taken back by undo, and one that is being made is drawn after its end', async () => {
  const { drawing, given } = draw(read('....', '....'))
  click(drawing, 'fill', CROP, 0.5)
  click(drawing, 'fill', WEED, 2.5)
  drawing.undo()
  drawing.begin('fill', IGNORED, 1, { x: 3.5, y: 0.5 })
  const settled = drawing.settle()
  given.get('fill')?.give(HALVES)
  await settled
  assert.deepEqual(show(drawing.classes), ['cc..', 'cc..'])
  drawing.end()
  await drawing.settle()
  assert.deepEqual(show(drawing.classes), ['ccii', 'ccii'])
})

test('strokes wait on where superpixels cannot be computed, until they can', async () => {
  const { drawing, given } = draw(read('....', '....'))
  click(drawing, 'fill', CROP, 0.5)
  const failed = drawing.settle()
  given.get('fill')?.refuse(new Error('no memory'))
  await assert.rejects(failed, /no memory/)
  assert.equal(drawing.waitingCount, 1)
  const settled = drawing.settle()
  given.get('fill')?.give(HALVES)
  await settled
  assert.deepEqual(show(drawing.classes), ['cc..', 'cc..'])
})

test('a brush that renames leaves soil and what is ignored as they are', () => {
  const { drawing } = draw(read('w.ic', 'w.ic'))
  drawing.begin('rename', CROP, 9, { x: 2, y: 1 })
  drawing.end()
  assert.deepEqual(show(drawing.classes), ['c.ic', 'c.ic'])
})
