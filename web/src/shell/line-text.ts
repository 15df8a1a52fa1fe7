/** Why what is shown is not of now: the line, the robot or this device. */

import type { LinkMonitor } from '../link-monitor.ts'
import type { Store } from '../store.ts'
import { fixed } from '../format.ts'
import { say } from '../say.ts'

/** What is wrong with the line, the robot or this device; empty where what is shown is of now. */
export function tellLine(store: Store, nowMs: number, farewell: string): string {
  const { monitor, stale } = store
  const ageMs = store.ageMs(nowMs)
  const old = stale && Number.isFinite(ageMs) ? `${say('dataAreOld', { time: seconds(ageMs) })} ` : ''
  if (!store.linked) return `${old}${farewell || say('noLinkTryingAgain')}`
  if (!store.answers) return old + tellAnswer(monitor)
  if (!stale) return ''
  if (!old) return say('waitingForFirstData')
  return `${old}${say(monitor.isPageSlow ? 'tooSlow' : 'nothingNew')}`
}

function tellAnswer({ unansweredMs, roundTripMs }: LinkMonitor): string {
  if (roundTripMs > unansweredMs) return say('lineIsSlow', { time: seconds(roundTripMs) })
  return say('noAnswerFor', { time: seconds(unansweredMs) })
}

export function seconds(ms: number): string {
  return ms < 10_000 ? fixed(ms / 1000, 1, 's') : fixed(Math.floor(ms / 1000), 0, 's')
}
