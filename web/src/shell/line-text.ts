/** Why what is shown is not of now: the line, the robot or this device. */

import type { LinkMonitor } from '../link-monitor.ts'
import type { Store } from '../store.ts'

const TOO_SLOW =
  'This device is too slow for what it draws; close other programs, or make the window smaller. The robot answers.'

/** What is wrong with the line, the robot or this device; empty where what is shown is of now. */
export function tellLine(store: Store, nowMs: number, farewell: string): string {
  const { monitor, stale } = store
  const ageMs = store.ageMs(nowMs)
  const old = stale && Number.isFinite(ageMs) ? `What you see is ${seconds(ageMs)} old. ` : ''
  if (!store.linked) return `${old}${farewell || 'No link to the robot, trying again…'}`
  if (!store.answers) return old + tellAnswer(monitor)
  if (!stale) return ''
  if (!old) return 'Waiting for the first data of the robot…'
  return `${old}${monitor.isPageSlow ? TOO_SLOW : 'The robot sends nothing new.'}`
}

function tellAnswer({ unansweredMs, roundTripMs }: LinkMonitor): string {
  if (roundTripMs > unansweredMs) return `The line is slow: the robot answers after ${seconds(roundTripMs)}.`
  return `No answer from the robot for ${seconds(unansweredMs)}.`
}

export function seconds(ms: number): string {
  return ms < 10_000 ? `${(ms / 1000).toFixed(1)} s` : `${Math.floor(ms / 1000)} s`
}
