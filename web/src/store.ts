/** What the page knows: the last state, the whole trajectory, the weeds, the log, the signals. */

import { Emitter } from './emitter.ts'
import { LATE_MS, LinkMonitor } from './link-monitor.ts'
import { SignalBuffer } from './plots/buffer.ts'
import { StopRequest } from './stop-request.ts'
import { Trajectory } from './trajectory.ts'
import type { Growth, LogEvent, Mode, PathData, Seat, ServerMessage, Snapshot, State, Weed } from './wire.ts'

const LOG_LENGTH = 500

export interface WeedChange {
  set: Weed[]
  gone: number[]
  all: boolean
}
/** What is shown: the robot, or the recording of this name. */
export interface Channel {
  source: string
  name: string
}

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
  /** Something else is shown than before, or another place in it: what was gathered belongs to that. */
  restart: null
  channel: Channel
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
  linked = false
  stale = true
  channel: Channel | null = null
  /** The robot's own mode and stop while a recording is shown. */
  live: { mode: Mode; stop: string } | null = null
  /** False where a recording alone is served. */
  hasRobot = true
  readonly monitor = new LinkMonitor()
  readonly stop = new StopRequest()
  private epoch: number | null = null
  private shownEpoch: number | null = null
  readonly counters = { state: 0, cam: 0, weeds: 0, traj: 0, dropped: 0, foreign: 0 }

  /** Milliseconds since the robot was as the last state tells, by its own clock; infinite while unknown. */
  ageMs(nowMs: number): number {
    return this.state ? this.monitor.ageMs(this.state.mono_ms, nowMs) : Infinity
  }

  checkAge(nowMs: number): void {
    const stale = this.ageMs(nowMs) > LATE_MS
    if (stale === this.stale) return
    this.stale = stale
    this.emit('stale', stale)
  }

  /** Whether the robot answers in time. */
  get answers(): boolean {
    return this.linked && this.monitor.answers
  }

  setLinked(linked: boolean): void {
    this.linked = linked
    this.epoch = null // whatever comes first on a new line, it begins with a snapshot
    this.emit('link', linked)
  }

  /** Take in one message of the server; acks and the end of the session are the link's business. */
  accept(message: ServerMessage, nowMs: number): void {
    switch (message.k) {
      case 's':
        if (this.belongs(message)) this.acceptState(message, nowMs)
        break
      case 'traj':
      case 'path':
      case 'weeds':
      case 'events':
        if (this.belongs(message)) this.acceptGrowth(message)
        break
      case 'snap':
        this.acceptSnapshot(message)
        break
      case 'hello':
      case 'seat':
        this.acceptSeat(message)
        break
      case 'live':
        this.live = { mode: message.mode, stop: message.stop }
        this.stop.see(Boolean(message.stop))
        break
      case 'field':
        this.emit('field', null)
        break
      case 'pong':
        this.monitor.pong(message.c, message.mono_ms, message.wall_ms, nowMs)
        break
    }
  }

  /** False for what belongs to something that is not shown any more. */
  private belongs(message: { e: number }): boolean {
    if (message.e === this.epoch) return true
    this.counters.foreign++
    return false
  }

  private acceptState(state: State, nowMs: number): void {
    if (this.state && state.n > this.state.n + 1) this.counters.dropped += state.n - this.state.n - 1
    this.state = state
    this.counters.state++
    if (!state.replay) this.stop.see(Boolean(state.stop))
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

  private acceptSnapshot(snap: Snapshot): void {
    this.epoch = snap.e
    this.show(snap)
    this.trajectory.restart(snap.traj.first, snap.traj.xy)
    this.counters.traj = snap.traj.xy.length
    this.path = snap.path.xy.length ? snap.path : null
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

  /** A page that only lost its line for a while keeps what its displays have gathered. */
  private show({ e, source, name }: Snapshot): void {
    const before = this.channel
    this.channel = { source, name }
    if (e !== this.shownEpoch) {
      this.shownEpoch = e
      this.state = null
      this.live = null
      this.signals.clear()
      this.emit('restart', null)
    }
    if (before?.source !== source || before.name !== name) this.emit('channel', this.channel)
  }

  private acceptGrowth(message: Growth): void {
    switch (message.k) {
      case 'traj':
        this.trajectory.extend(message.first, message.xy)
        this.counters.traj += message.xy.length
        this.emit('trajectory', this.trajectory)
        break
      case 'path':
        this.acceptPath(message)
        break
      case 'weeds':
        this.acceptWeeds(message.rev, message.set, message.gone)
        break
      case 'events':
        this.log.push(...message.events)
        this.log.splice(0, this.log.length - LOG_LENGTH)
        this.emit('log', this.log)
        break
    }
  }

  private acceptPath({ first, xy, row }: { first: number } & PathData): void {
    const known = first && this.path ? this.path : { xy: [], row: [] }
    this.path = { xy: [...known.xy.slice(0, first), ...xy], row: [...known.row.slice(0, first), ...row] }
    this.emit('path', this.path)
  }

  private acceptWeeds(revision: number, set: Weed[], gone: number[]): void {
    for (const weed of set) this.weeds.set(weed[0], weed)
    for (const id of gone) this.weeds.delete(id)
    this.weedsRevision = revision
    this.counters.weeds = this.weeds.size
    this.emit('weeds', { set, gone, all: false })
  }
}
