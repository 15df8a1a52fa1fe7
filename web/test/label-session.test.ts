import assert from 'node:assert/strict'
import { test } from 'node:test'
import type { LabelCanvas } from '../src/label/canvas.ts'
import { CROP, SOIL, WEED } from '../src/label/painting.ts'
import { Session } from '../src/label/session.ts'

const SIZE = { 'x-width': '4', 'x-height': '1' }
const DRAFTED = '/api/v1/pictures/0/classes?done=0'
const FINISHED = '/api/v1/pictures/0/classes?done=1'

/** A server with one picture, whose superpixels come when the test gives them, and a page on it. */
async function open() {
  const saved: [string, number[]][] = []
  let giveSuperpixels = (_: Response): void => undefined
  const superpixels = new Promise<Response>((give) => {
    giveSuperpixels = give
  })
  const state = (): string => (saved.some(([path]) => path === FINISHED) ? 'done' : 'new')
  globalThis.fetch = async (path, init) => {
    if (String(path).endsWith('/superpixels')) return superpixels
    if (String(path).endsWith('/picture')) return new Response(new Uint8Array(4))
    if (String(path).endsWith('/classes')) return new Response(Uint8Array.of(WEED, WEED, SOIL, SOIL), { headers: SIZE })
    if (init?.method === 'PUT') saved.push([String(path), [...(init.body as Uint8Array)]])
    if (init?.method === 'PUT') return new Response(null, { status: 204, headers: { etag: '"2"' } })
    return Response.json({ about: '', pictures: [{ number: 0, name: 'a', state: state(), uncertainty: 0.5 }] })
  }
  globalThis.createImageBitmap = async () => ({ width: 4, height: 1 }) as ImageBitmap
  const nothing = (): void => undefined
  const session = new Session({
    show: nothing,
    draw: nothing,
    clear: nothing,
    showPieces: nothing,
  } as unknown as LabelCanvas)
  await session.start()
  const give = (): void => giveSuperpixels(new Response(Uint16Array.of(1, 1, 2, 2), { headers: SIZE }))
  return { session, saved, give }
}

test('Enter waits for superpixels, and saves the strokes that were made while they were computed', async () => {
  const { session, saved, give } = await open()
  const ready = session.setTool('fill')
  session.kind = CROP
  session.begin({ x: 0.5, y: 0.5 }, false)
  session.end()
  assert.deepEqual([session.computing, session.isUnsaved], ['superpixels', true])
  const finished = session.finish()
  await new Promise(setImmediate)
  assert.deepEqual(saved, []) // not the guess of the network
  give()
  await Promise.all([ready, finished])
  const drawn = [CROP, CROP, SOIL, SOIL]
  assert.deepEqual(saved, [
    [DRAFTED, drawn],
    [FINISHED, drawn],
  ])
  assert.deepEqual([session.computing, session.isUnsaved], [null, false])
})

test('one press makes all weed of a picture crop, and undo takes it back', async () => {
  const { session, saved } = await open()
  await session.renameAll(WEED, CROP)
  await session.flush()
  session.undo()
  await session.flush()
  assert.deepEqual(saved, [
    [DRAFTED, [CROP, CROP, SOIL, SOIL]],
    [DRAFTED, [WEED, WEED, SOIL, SOIL]],
  ])
})
