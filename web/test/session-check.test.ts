import assert from 'node:assert/strict'
import { test } from 'node:test'
import { sessionCheck } from '../src/shell/session-check.ts'
import type { SessionInfo } from '../src/wire.ts'

const answer = (run: number, needs_login = false): SessionInfo => ({
  version: '1',
  run,
  profile: 'farm',
  source: 'sim',
  role: 'operator',
  lan_url: null,
  qr_svg: null,
  camera: true,
  needs_login,
})

/** What the check makes of an answer: the run that the line has to expect, and loads of the page. */
async function checked(asked: () => Promise<SessionInfo>): Promise<{ runs: number[]; loads: number }> {
  const runs: number[] = []
  let loads = 0
  const check = sessionCheck({ expect: (run) => runs.push(run) }, asked, () => loads++)
  check()
  await new Promise((resolve) => setImmediate(resolve))
  return { runs, loads }
}

test('another run is left to the line, which says a STOP first, and the page is not loaded at once', async () => {
  assert.deepEqual(await checked(async () => answer(2)), { runs: [2], loads: 0 })
})

test('a run that wants a login loads the page anew, for no line opens before', async () => {
  assert.deepEqual(await checked(async () => answer(2, true)), { runs: [], loads: 1 })
})

test('a robot that does not answer is asked again with the next line that fails', async () => {
  const failing = (): Promise<SessionInfo> => Promise.reject(new Error('away'))
  assert.deepEqual(await checked(failing), { runs: [], loads: 0 })
})
