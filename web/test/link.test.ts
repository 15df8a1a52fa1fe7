import assert from 'node:assert/strict'
import { test } from 'node:test'
import { DEAD_MS, LATE_MS, LinkMonitor, SILENT_MS } from '../src/link-monitor.ts'
import { tellLine } from '../src/shell/line-text.ts'
import { StopRequest } from '../src/stop-request.ts'
import { Store } from '../src/store.ts'
import type { State } from '../src/wire.ts'

const AHEAD_MS = 1e6 // the robot's clock before the page's

/** Awake from one time to the other, with a look at the clock every tenth of a second. */
function pass(monitor: LinkMonitor, fromMs: number, toMs: number): void {
  for (let t = fromMs; t <= toMs; t += 100) monitor.tick(t)
}

/** A ping and its answer over a line with a time there and a time back. */
function answered(monitor: LinkMonitor, sentMs: number, thereMs: number, backMs: number): void {
  monitor.sent(sentMs)
  pass(monitor, sentMs, sentMs + thereMs + backMs)
  monitor.pong(sentMs, sentMs + thereMs + AHEAD_MS, 0, sentMs + thereMs + backMs)
}

test('the age of a state is that on the robot, however long it was on its way', () => {
  const monitor = new LinkMonitor()
  assert.equal(monitor.ageMs(AHEAD_MS, 0), Infinity)
  answered(monitor, 0, 2, 2)
  assert.equal(monitor.ageMs(1000 + AHEAD_MS, 24_000), 23_000)
})

test('an answer that was long on its way does not spoil the clock of a quick one', () => {
  const monitor = new LinkMonitor()
  answered(monitor, 0, 2, 2)
  answered(monitor, 1000, 5, 4000)
  assert.equal(monitor.robotMs(6000), 6000 + AHEAD_MS)
  assert.equal(monitor.rttMs, 4005)
})

test('a clock that jumped is believed at once, as after the page was put to sleep', () => {
  const monitor = new LinkMonitor()
  answered(monitor, 0, 2, 2)
  monitor.sent(1000)
  monitor.pong(1000, 61_000 + AHEAD_MS, 0, 1004)
  assert.equal(monitor.robotMs(1004), 61_002 + AHEAD_MS)
})

test('a line that falls silent shows the time of the missing answer, not of the last one', () => {
  const monitor = new LinkMonitor()
  answered(monitor, 0, 1, 1)
  monitor.sent(250)
  monitor.sent(500)
  assert.ok(monitor.answers)
  pass(monitor, 0, SILENT_MS + 300)
  assert.ok(!monitor.answers, 'within a second')
  pass(monitor, 1000, 2000)
  assert.ok(monitor.roundTripMs > LATE_MS)
  monitor.pong(250, 251 + AHEAD_MS, 0, 2010)
  assert.ok(monitor.unansweredMs > LATE_MS, 'the later ping is still missing')
  monitor.pong(500, 501 + AHEAD_MS, 0, 2020)
  assert.equal(monitor.unansweredMs, 0)
})

test('a page that stood still itself does not give up its line', () => {
  const monitor = new LinkMonitor()
  answered(monitor, 0, 1, 1)
  monitor.sent(100)
  monitor.tick(60_000)
  assert.ok(monitor.answers)
  pass(monitor, 60_000, 64_000)
  assert.ok(monitor.unansweredMs > DEAD_MS)
  monitor.tick(120_000)
  monitor.pong(100, 101 + AHEAD_MS, 0, 120_000)
  assert.ok((monitor.rttMs ?? 0) < 5000, 'nor is what it slept the time of an answer')
})

test('a page that stands still while it draws is slow, and one that slept or paused once is not', () => {
  const monitor = new LinkMonitor()
  pass(monitor, 0, 1000)
  assert.equal(monitor.isPageSlow, false)
  monitor.tick(2100) // one pause of a second
  pass(monitor, 2100, 3000)
  assert.equal(monitor.isPageSlow, false)
  monitor.tick(4000)
  assert.equal(monitor.isPageSlow, true)
  pass(monitor, 4000, 9100)
  assert.equal(monitor.isPageSlow, false, 'five seconds later')
  monitor.tick(3_600_000)
  assert.equal(monitor.isPageSlow, false, 'a device that slept')
})

test('what is old because this device draws too slowly is not blamed on the robot', () => {
  const store = new Store()
  store.setLinked(true)
  answered(store.monitor, 0, 2, 2)
  store.state = { mono_ms: AHEAD_MS } as State
  pass(store.monitor, 100, 2000)
  store.checkAge(2000)
  assert.equal(tellLine(store, 2000, ''), 'What you see is 2.0 s old. The robot sends nothing new.')
  for (let t = 3900; t < 10_000; t += 1900) store.monitor.tick(t)
  answered(store.monitor, 9700, 2, 2)
  store.checkAge(9704)
  assert.match(tellLine(store, 9704, ''), /^What you see is 9\.7 s old\. This device is too slow for what it draws; /)
  assert.equal(store.isSlow, true)
  store.setLinked(false)
  assert.match(tellLine(store, 9704, ''), /No link to the robot/)
})

test('a new connection waits for nothing of the old one', () => {
  const monitor = new LinkMonitor()
  answered(monitor, 0, 1, 1)
  monitor.sent(100)
  pass(monitor, 100, 9000)
  monitor.open(9000)
  assert.equal(monitor.roundTripMs, 0)
  assert.equal(monitor.ageMs(AHEAD_MS, 9000), 9000, 'what is shown grows old all the same')
})

test('a stop is confirmed when the server heard it and the robot stands under it', () => {
  const stop = new StopRequest()
  stop.see(true)
  assert.equal(stop.isPending, false)
  stop.press(100)
  assert.equal(stop.isUnheard, true)
  stop.hear(true)
  assert.equal(stop.isUnheard, false)
  stop.see(false)
  assert.equal(stop.waitedMs(1300), 1200)
  stop.see(true)
  assert.equal(stop.isPending, false)
})

test('a robot that was stopped before does not confirm a stop that did not reach it', () => {
  const stop = new StopRequest()
  stop.press(100)
  stop.see(true)
  assert.equal(stop.isPending, true)
  stop.hear(true)
  assert.equal(stop.isPending, false)
})

test('what the server of a program that ended heard is said again on the next line', () => {
  const stop = new StopRequest()
  stop.press(100)
  stop.hear(true) // and its robot is gone before it stopped
  stop.repeat()
  assert.equal(stop.isUnheard, true)
  stop.see(true) // the next robot stands under a stop of its own
  assert.equal(stop.isPending, true)
  stop.hear(true)
  assert.equal(stop.isPending, false)
  assert.equal(stop.waitedMs(500), 0)
})

test('where no robot runs the server is all that can confirm', () => {
  const stop = new StopRequest()
  stop.press(0)
  stop.hear(false)
  assert.equal(stop.isPending, false)
})
