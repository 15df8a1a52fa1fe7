import assert from 'node:assert/strict'
import { test } from 'node:test'
import { parseCameraPacket, parseMessage } from '../src/decode.ts'

test('only objects of a known kind are messages', () => {
  assert.equal(parseMessage('{"kind":"pong","sent_ms":5}')?.kind, 'pong')
  for (const text of ['', 'null', '[]', '{"kind":"evil"}', '{"kind":7}', '{']) assert.equal(parseMessage(text), null)
})

test('a camera packet is read as the server writes it', () => {
  const bytes = new ArrayBuffer(19)
  const view = new DataView(bytes)
  view.setUint8(0, 1)
  view.setUint8(1, 2)
  view.setUint32(4, 77)
  view.setFloat64(8, 1234.5)
  new Uint8Array(bytes, 16).set([9, 8, 7])
  const packet = parseCameraPacket(bytes)
  assert.deepEqual(
    { ...packet, file: [...(packet?.file ?? [])] },
    { kind: 'mask', level: 2, frame: 77, wallMs: 1234.5, file: [9, 8, 7] },
  )
})

test('a camera packet of another kind or with no file is refused', () => {
  assert.equal(parseCameraPacket(new ArrayBuffer(16)), null)
  const odd = new Uint8Array(20)
  odd[0] = 5
  assert.equal(parseCameraPacket(odd.buffer), null)
})
