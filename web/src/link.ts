/** The state and command socket: measures the line, gives up a dead one, reconnects, waits for acks. */

import { parseMessage } from './decode.ts'
import { DEAD_MS, PING_MS } from './link-monitor.ts'
import type { Store } from './store.ts'
import type { PageMessage, PageRequest, ServerMessage, Verdict } from './wire.ts'
import { language, say } from './say.ts'

const TICK_MS = 100
/** The id of every STOP of this page: it is said again until one is answered. */
const STOP_ID = 'stop'
const ACK_TIMEOUT_MS = 5000
const BACKOFF_MS = [0, 250, 500, 1000]
/** A connection that is not open by then is tried anew: that of a lost network would wait for a minute. */
const OPEN_MS = [3000, 4000, 5000]
/** What was received is acknowledged after this time or this many bytes, but not all the time. */
const GOT_AFTER_MS = 100
const GOT_AFTER_BYTES = 2000
const GOT_APART_MS = 20

/** What became of a command. */
export type Outcome = Pick<Verdict, 'ok' | 'reason'>

/** `path` on this page's own host, as a WebSocket address. */
export function socketUrl(path: string): string {
  const url = new URL(path, location.href)
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:'
  return url.href
}

const TAB = 'tab'

/**
 * This tab's name in its session: a reload is the same operator, a second tab is another one.
 *
 * It lies in the tab's storage only while no page is seen in it: a tab that is made from another one begins
 * with a copy of that.
 */
function tabId(): string {
  const name = sessionStorage.getItem(TAB) ?? madeName()
  sessionStorage.removeItem(TAB)
  const keep = (isAway: boolean): void => (isAway ? sessionStorage.setItem(TAB, name) : sessionStorage.removeItem(TAB))
  window.addEventListener('pagehide', () => keep(true))
  window.addEventListener('pageshow', () => keep(false))
  document.addEventListener('visibilitychange', () => keep(document.hidden)) // a phone may end a hidden page
  return name
}

function madeName(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(8))
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, '0')).join('')
}

export function savedScale(): number {
  return Number(localStorage.getItem('speed-scale') ?? 0.5)
}

export class Link {
  private socket: WebSocket | null = null
  private attempt = 0
  private nextId = 1
  private retry = 0
  private openBy = Infinity
  private isOpened = false
  private session: string | null = null
  private isOutdated = false
  private pingedMs = -Infinity
  private received = { count: 0, bytes: 0, toldCount: 0, toldMs: 0 }
  private readonly waiting = new Map<string, (outcome: Outcome) => void>()
  private readonly store: Store
  private readonly tab = tabId()
  /** The run that this page is of: that which first says so. */
  private run: number | null = null
  /** No line is wanted now. */
  isResting = false
  farewell = ''
  /** A refusal of something that no command waits for. */
  onRefusal: (reason: string) => void = () => undefined
  /** A line was lost before it was open: its server may be away, or refuse this browser. */
  onUnopened: () => void = () => undefined
  /** What answers is not what this page was loaded from. */
  onOutdated: () => void = () => undefined

  constructor(store: Store) {
    this.store = store
  }

  start(): void {
    this.open()
    setInterval(() => this.tick(performance.now()), TICK_MS)
    window.addEventListener('online', () => this.hurry())
  }

  /** Give up the line until it is wanted again. */
  rest(): void {
    this.isResting = true
    clearTimeout(this.retry)
    this.drop(this.socket)
    this.socket = null
    this.openBy = Infinity
    this.store.setLinked(false)
  }

  resume(): void {
    this.isResting = false
    this.attempt = 0
    this.open()
  }

  private open(): void {
    clearTimeout(this.retry)
    const socket = new WebSocket(socketUrl(`/ws/v1?tab=${this.tab}&acks=1&language=${language}`))
    this.socket = socket
    this.isOpened = false
    this.openBy = performance.now() + OPEN_MS[Math.min(this.attempt, OPEN_MS.length - 1)]
    socket.onopen = () => this.opened()
    socket.onmessage = (event: MessageEvent<unknown>) => this.receive(event.data)
    socket.onclose = (event) => {
      this.farewell ||= event.reason
      this.lost()
    }
  }

  private opened(): void {
    const nowMs = performance.now()
    this.isOpened = true
    this.openBy = Infinity
    this.farewell = ''
    this.received = { count: 0, bytes: 0, toldCount: 0, toldMs: nowMs }
    this.store.monitor.open(nowMs)
    const name = localStorage.getItem('operator')
    if (name) this.send({ kind: 'use_name', name })
    this.send({ kind: 'scale_speed', ratio: savedScale() })
    this.ping(nowMs)
    this.store.setLinked(true)
    this.repeatStop()
  }

  /** A network is back: do not wait for the next try. */
  private hurry(): void {
    if (this.isResting || this.socket?.readyState === WebSocket.OPEN) return
    this.attempt = 0
    this.drop(this.socket)
    this.open()
  }

  private tick(nowMs: number): void {
    const { monitor } = this.store
    monitor.tick(nowMs)
    if (this.socket?.readyState === WebSocket.OPEN) {
      if (monitor.unansweredMs > DEAD_MS) this.giveUp()
      else if (nowMs - this.pingedMs >= PING_MS) this.ping(nowMs)
      this.acknowledge(nowMs)
    } else if (nowMs > this.openBy) this.giveUp()
    this.store.checkAge(nowMs)
  }

  /** A socket without an answer would say so only after a minute or more. */
  private giveUp(): void {
    this.drop(this.socket)
    this.lost()
  }

  private drop(socket: WebSocket | null): void {
    if (!socket) return
    socket.onopen = socket.onmessage = socket.onclose = null
    socket.close()
  }

  /** True when the message was handed to an open socket. */
  send(message: PageMessage): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false
    this.socket.send(JSON.stringify(message))
    return true
  }

  /** Stop the robot; where the line does not carry it, it is said again on the next one. */
  stop(): void {
    this.store.stop.press(performance.now())
    this.send({ kind: 'press_stop', id: STOP_ID })
  }

  /** Say a STOP that no robot has confirmed again, to the robot at the other end of this line. */
  private repeatStop(): void {
    if (!this.store.stop.isPending) return
    this.store.stop.repeat()
    this.send({ kind: 'press_stop', id: STOP_ID })
  }

  /** Send a command and wait for what the robot says to it. */
  command(command: PageRequest): Promise<Outcome> {
    const id = `c${this.nextId++}`
    if (!this.send({ ...command, id })) return Promise.resolve({ ok: false, reason: say('noLink') })
    return new Promise((resolve) => {
      const timer = setTimeout(() => this.settle(id, { ok: false, reason: say('noAnswerIn5S') }), ACK_TIMEOUT_MS)
      this.waiting.set(id, (outcome) => {
        clearTimeout(timer)
        resolve(outcome)
      })
    })
  }

  private receive(data: unknown): void {
    const nowMs = performance.now()
    this.attempt = 0
    this.received.count++
    this.received.bytes += typeof data === 'string' ? data.length : 0
    const message = typeof data === 'string' ? parseMessage(data) : null
    if (message) this.take(message, nowMs)
    this.acknowledge(nowMs)
  }

  private take(message: ServerMessage, nowMs: number): void {
    if (message.kind === 'hello') this.meet(message.run, message.session)
    if (message.kind === 'verdict') this.hear(message)
    else if (message.kind === 'bye') this.farewell = message.reason
    else this.store.accept(message, nowMs)
  }

  /** Another run of the robot's program, or one that knows this browser as somebody else. */
  private meet(run: number, session: string): void {
    this.run ??= run
    this.session ??= session
    this.isOutdated = run !== this.run || session !== this.session
    this.renew()
  }

  /** The run that this page belongs to; its line may have reached another one meanwhile. */
  expect(run: number): void {
    this.run ??= run
    if (run !== this.run) this.isOutdated = true
    this.renew()
  }

  /** A page that is loaded anew forgets its STOP, and therefore says it first. */
  private renew(): void {
    if (this.isOutdated && !this.store.stop.isUnheard) this.onOutdated()
  }

  private acknowledge(nowMs: number): void {
    const { received } = this
    const sinceMs = nowMs - received.toldMs
    const isMuch = received.bytes >= GOT_AFTER_BYTES && sinceMs >= GOT_APART_MS
    if (received.count === received.toldCount || (!isMuch && sinceMs < GOT_AFTER_MS)) return
    this.received = { count: received.count, bytes: 0, toldCount: received.count, toldMs: nowMs }
    this.send({ kind: 'receipt', count: received.count })
  }

  private hear(verdict: Verdict): void {
    if (verdict.id === STOP_ID && verdict.ok) {
      this.store.stop.hear(this.store.hasRobot)
      this.renew()
    } else if (this.waiting.has(verdict.id)) this.settle(verdict.id, verdict)
    else if (!verdict.ok) this.onRefusal(verdict.reason)
  }

  private settle(id: string, outcome: Outcome): void {
    this.waiting.get(id)?.(outcome)
    this.waiting.delete(id)
  }

  private ping(nowMs: number): void {
    this.pingedMs = nowMs
    this.store.monitor.sent(nowMs)
    this.send({ kind: 'ping', sent_ms: nowMs })
  }

  private lost(): void {
    if (!this.isOpened) this.onUnopened()
    this.openBy = Infinity
    this.store.setLinked(false)
    for (const id of [...this.waiting.keys()]) this.settle(id, { ok: false, reason: say('linkBroke') })
    const pause = BACKOFF_MS[Math.min(this.attempt++, BACKOFF_MS.length - 1)]
    clearTimeout(this.retry)
    this.retry = window.setTimeout(() => this.open(), pause)
  }
}
