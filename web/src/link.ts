/** The state and command socket: reconnects with growing pauses, measures the round trip, waits for acks. */

import type { Store } from './store.ts'
import type { ClientMessage, Command } from './wire.ts'
import { parseMessage } from './wire.ts'

const PING_MS = 500
const ACK_TIMEOUT_MS = 5000
const BACKOFF_MS = [250, 500, 1000, 2000, 5000]

export interface Ack { ok: boolean; reason: string }

/** `path` on this page's own host, as a WebSocket address. */
export function socketUrl(path: string): string {
  const url = new URL(path, location.href)
  url.protocol = url.protocol === 'https:' ? 'wss:' : 'ws:'
  return url.href
}

export class Link {
  private socket: WebSocket | null = null
  private attempt = 0
  private nextId = 1
  private readonly waiting = new Map<string, (ack: Ack) => void>()
  private readonly store: Store
  farewell = ''

  constructor(store: Store) {
    this.store = store
  }

  open(): void {
    const socket = new WebSocket(socketUrl('/ws/v1'))
    this.socket = socket
    socket.onopen = () => {
      this.attempt = 0
      this.farewell = ''
      const name = localStorage.getItem('operator')
      if (name) this.send({ k: 'name', name })
      this.store.setLinked(true)
      this.ping()
    }
    socket.onmessage = (event: MessageEvent<unknown>) => this.receive(event.data)
    socket.onclose = () => this.lost()
  }

  start(): void {
    this.open()
    setInterval(() => this.ping(), PING_MS)
    setInterval(() => this.store.checkAge(performance.now()), 200)
  }

  /** True when the message was handed to an open socket. */
  send(message: ClientMessage): boolean {
    if (this.socket?.readyState !== WebSocket.OPEN) return false
    this.socket.send(JSON.stringify(message))
    return true
  }

  /** Send a command and wait for what the robot says to it. */
  command(command: Command): Promise<Ack> {
    const id = `c${this.nextId++}`
    if (!this.send({ ...command, id })) return Promise.resolve({ ok: false, reason: 'No link to the robot.' })
    return new Promise((resolve) => {
      const timer = setTimeout(() => this.settle(id, { ok: false, reason: 'The robot did not answer in 5 s.' }), ACK_TIMEOUT_MS)
      this.waiting.set(id, (ack) => {
        clearTimeout(timer)
        resolve(ack)
      })
    })
  }

  private receive(data: unknown): void {
    const message = typeof data === 'string' ? parseMessage(data) : null
    if (!message) return
    if (message.k === 'ack') this.settle(message.id, message)
    else if (message.k === 'bye') this.farewell = message.reason
    else this.store.accept(message, performance.now())
  }

  private settle(id: string, ack: Ack): void {
    this.waiting.get(id)?.(ack)
    this.waiting.delete(id)
  }

  private ping(): void {
    this.send({ k: 'ping', c: performance.now() })
  }

  private lost(): void {
    this.store.setLinked(false)
    for (const id of [...this.waiting.keys()]) this.settle(id, { ok: false, reason: 'The link broke before the robot answered.' })
    const pause = BACKOFF_MS[Math.min(this.attempt++, BACKOFF_MS.length - 1)]
    setTimeout(() => this.open(), pause)
  }
}
