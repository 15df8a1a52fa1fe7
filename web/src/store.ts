/** What the page knows: the last state, the whole trajectory, the weeds, the log, the signals. */

import { Emitter } from './emitter.ts'
import { SignalBuffer } from './plots/buffer.ts'
import { Trajectory } from './trajectory.ts'
import type { LogEvent, PathData, Seat, ServerMessage, State, Weed } from './wire.ts'

export const STALE_AFTER_MS = 1000
const LOG_LENGTH = 500

export interface WeedChange { set: Weed[]; gone: number[]; all: boolean }

interface Events {
  state: State
  trajectory: Trajectory
  path: PathData | null
  weeds: WeedChange
  log: LogEvent[]
  seat: Seat
  link: boolean
  signals: SignalBuffer
  stale: boolean
  /** Another field or task: what was read of it is out of date. */
  field: null
}

export class Store extends Emitter<Events> {
  state: State | null = null
  readonly trajectory = new Trajectory()
  path: PathData | null = null
  readonly weeds = new Map<number, Weed>()
  weedsRevision = 0
  log: LogEvent[] = []
  signals = new SignalBuffer([], [])
  seat: Seat = 'free'
  holder = ''
  clients = 0
  source = ''
  linked = false
  rttMs: number | null = null
  receivedMs = 0
  stale = true
  readonly counters = { state: 0, cam: 0, weeds: 0, traj: 0, dropped: 0 }

  /** Milliseconds since the last state came in; infinite before the first. */
  ageMs(nowMs: number): number {
    return this.receivedMs ? nowMs - this.receivedMs : Infinity
  }

  checkAge(nowMs: number): void {
    const stale = this.ageMs(nowMs) > STALE_AFTER_MS
    if (stale === this.stale) return
    this.stale = stale
    this.emit('stale', stale)
  }

  setLinked(linked: boolean): void {
    this.linked = linked
    if (!linked) this.rttMs = null
    this.emit('link', linked)
  }

  /** Take in one message of the server; acks and the end of the session are the link's business. */
  accept(message: ServerMessage, nowMs: number): void {
    switch (message.k) {
      case 's':
        this.acceptState(message, nowMs)
        break
      case 'hello':
        this.source = message.source
        this.acceptSeat(message)
        break
      case 'seat':
        this.acceptSeat(message)
        break
      case 'snap':
        this.acceptSnapshot(message)
        break
      case 'traj':
        this.trajectory.extend(message.first, message.xy)
        this.counters.traj += message.xy.length
        this.emit('trajectory', this.trajectory)
        break
      case 'path':
        this.path = message
        this.emit('path', message)
        break
      case 'weeds':
        this.acceptWeeds(message.rev, message.set, message.gone)
        break
      case 'event':
        this.log.push(message)
        if (this.log.length > LOG_LENGTH) this.log.shift()
        this.emit('log', this.log)
        break
      case 'field':
        this.emit('field', null)
        break
      case 'pong':
        this.rttMs = nowMs - message.c
        break
    }
  }

  private acceptState(state: State, nowMs: number): void {
    if (this.state && state.n > this.state.n + 1) this.counters.dropped += state.n - this.state.n - 1
    this.state = state
    this.receivedMs = nowMs
    this.counters.state++
    if (state.sig?.length && this.signals.extend(state.sig)) this.emit('signals', this.signals)
    this.checkAge(nowMs)
    this.emit('state', state)
  }

  private acceptSeat(message: { seat: Seat; holder: string; clients: number }): void {
    this.seat = message.seat
    this.holder = message.holder
    this.clients = message.clients
    this.emit('seat', message.seat)
  }

  private acceptSnapshot(snap: Extract<ServerMessage, { k: 'snap' }>): void {
    this.trajectory.restart(snap.traj.first, snap.traj.xy)
    this.counters.traj = snap.traj.xy.length
    this.path = snap.path
    this.weeds.clear()
    for (const weed of snap.weeds.all) this.weeds.set(weed[0], weed)
    this.weedsRevision = snap.weeds.rev
    this.counters.weeds = this.weeds.size
    this.log = snap.events.slice(-LOG_LENGTH)
    this.signals.rename(snap.signals.names, snap.signals.units)
    this.emit('trajectory', this.trajectory)
    this.emit('path', this.path)
    this.emit('weeds', { set: snap.weeds.all, gone: [], all: true })
    this.emit('signals', this.signals)
    this.emit('log', this.log)
  }

  private acceptWeeds(revision: number, set: Weed[], gone: number[]): void {
    for (const weed of set) this.weeds.set(weed[0], weed)
    for (const id of gone) this.weeds.delete(id)
    this.weedsRevision = revision
    this.counters.weeds = this.weeds.size
    this.emit('weeds', { set, gone, all: false })
  }
}
