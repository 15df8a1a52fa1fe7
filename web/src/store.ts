/** What the page knows: the last state, the whole trajectory, the weeds, the log, the signals. */

import { Emitter } from './emitter.ts'
import { LATE_MS, LinkMonitor } from './link-monitor.ts'
import { SignalBuffer } from './plots/buffer.ts'
import { StopRequest } from './stop-request.ts'
import { Trajectory } from './trajectory.ts'
import type {
  Growth,
  LiveState,
  LogEvent,
  PathPiece,
  ReceiverState,
  SeatState,
  ServerMessage,
  Snapshot,
  State,
  Weed,
  WeedChanges,
} from './wire.ts'
import { readWeed } from './wire.ts'

const LOG_LENGTH = 500

export interface WeedUpdate {
  set: Weed[]
  gone: number[]
  all: boolean
}
/** The planned path as far as it has come. */
export type Path = Pick<PathPiece, 'points_map_m' | 'rows'>

/** What is shown: the robot, or the recording of this name. */
export interface Channel {
  source: string
  name: string
}

interface Events {
  state: State
  trajectory: Trajectory
  path: Path | null
  weeds: WeedUpdate
  log: LogEvent[]
  receiver: ReceiverState | null
  seat: SeatState
  link: boolean
  signals: SignalBuffer
  stale: boolean
  /** This device is too slow for what is drawn: draw less, until the page is loaded again. */
  slow: null
  /** Something else is shown than before, or another place in it: what was gathered belongs to that. */
  restart: null
  channel: Channel
  /** Another field or task: what was read of it is out of date. */
  field: null
}

export class Store extends Emitter<Events> {
  state: State | null = null
  readonly trajectory = new Trajectory()
  path: Path | null = null
  readonly weeds = new Map<number, Weed>()
  log: LogEvent[] = []
  receiver: ReceiverState | null = null
  signals = new SignalBuffer([], [])
  seat: SeatState = 'free'
  holder = ''
  clients = 0
  linked = false
  stale = true
  /** Whether this device was too slow once. */
  isSlow = false
  channel: Channel | null = null
  /** The robot's own mode and stop while a recording is shown. */
  live: LiveState | null = null
  /** False where a recording alone is served, as the first answer of the robot says. */
  hasRobot = true
  readonly monitor = new LinkMonitor()
  readonly stop = new StopRequest()
  private epoch: number | null = null
  private shownEpoch: number | null = null
  readonly counters = { state: 0, cam: 0, weeds: 0, traj: 0, dropped: 0, foreign: 0 }

  /** Milliseconds since the robot was as in the last state, by its own clock; infinite while unknown. */
  ageMs(nowMs: number): number {
    return this.state ? this.monitor.ageMs(this.state.mono_ms, nowMs) : Infinity
  }

  checkAge(nowMs: number): void {
    if (!this.isSlow && this.monitor.isPageSlow) {
      this.isSlow = true
      this.emit('slow', null)
    }
    const stale = this.ageMs(nowMs) > LATE_MS
    if (stale === this.stale) return
    this.stale = stale
    this.emit('stale', stale)
  }

  /** Whether the robot answers in time. */
  get answers(): boolean {
    return this.linked && this.monitor.answers
  }

  /** Whether a stop holds the robot, or was pressed here and is on its way. */
  get isStopped(): boolean {
    return this.stop.isPending || Boolean(this.state?.stop)
  }

  setHasRobot(hasRobot: boolean): void {
    this.hasRobot = hasRobot
    if (!hasRobot && this.stop.isPending && !this.stop.isUnheard) this.stop.hear(hasRobot)
  }

  setLinked(linked: boolean): void {
    this.linked = linked
    this.epoch = null // whatever comes first on a new line, it begins with a snapshot
    this.emit('link', linked)
  }

  /** Take in one message of the server; verdicts and the end of the session are the link's business. */
  accept(message: ServerMessage, nowMs: number): void {
    switch (message.kind) {
      case 'state':
        if (this.belongs(message)) this.acceptState(message, nowMs)
        break
      case 'trace':
      case 'path':
      case 'weeds':
      case 'events':
      case 'receiver':
        if (this.belongs(message)) this.acceptGrowth(message)
        break
      case 'snapshot':
        this.acceptSnapshot(message)
        break
      case 'hello':
      case 'seat':
        this.acceptSeat(message)
        break
      case 'live_state':
        this.live = message
        this.stop.see(Boolean(message.stop))
        break
      case 'field_change':
        this.emit('field', null)
        break
      case 'pong':
        this.monitor.pong(message.sent_ms, message.mono_ms, message.wall_ms, nowMs)
        break
    }
  }

  /** False for what belongs to something that is not shown any more. */
  private belongs(message: { epoch: number }): boolean {
    if (message.epoch === this.epoch) return true
    this.counters.foreign++
    return false
  }

  private acceptState(state: State, nowMs: number): void {
    if (this.state && state.tick > this.state.tick + 1) this.counters.dropped += state.tick - this.state.tick - 1
    this.state = state
    this.counters.state++
    if (!state.replay) this.stop.see(Boolean(state.stop))
    if (state.signals.length && this.signals.extend(state.signals)) this.emit('signals', this.signals)
    this.checkAge(nowMs)
    this.emit('state', state)
  }

  private acceptSeat(message: { seat: SeatState; holder: string; clients: number }): void {
    this.seat = message.seat
    this.holder = message.holder
    this.clients = message.clients
    this.emit('seat', message.seat)
  }

  private acceptSnapshot(snap: Snapshot): void {
    this.epoch = snap.epoch
    this.show(snap)
    this.trajectory.restart(snap.trace.first, snap.trace.points_map_m)
    this.counters.traj = snap.trace.points_map_m.length
    this.path = snap.path.points_map_m.length ? snap.path : null
    this.weeds.clear()
    const set = this.keepWeeds(snap.weeds)
    this.log = snap.events.events.slice(-LOG_LENGTH)
    this.signals.rename(snap.signals.names, snap.signals.units)
    this.emit('trajectory', this.trajectory)
    this.emit('path', this.path)
    this.emit('weeds', { set, gone: [], all: true })
    this.emit('signals', this.signals)
    this.emit('log', this.log)
  }

  /** A page that only lost its line for a while keeps what its displays have gathered. */
  private show({ epoch, source, name }: Snapshot): void {
    const before = this.channel
    this.channel = { source, name }
    if (epoch !== this.shownEpoch) {
      this.shownEpoch = epoch
      this.state = null
      this.live = null
      this.receiver = null
      this.signals.clear()
      this.emit('receiver', null)
      this.emit('restart', null)
    }
    if (before?.source !== source || before.name !== name) this.emit('channel', this.channel)
  }

  private acceptGrowth(message: Growth): void {
    switch (message.kind) {
      case 'trace':
        this.trajectory.extend(message.first, message.points_map_m)
        this.counters.traj += message.points_map_m.length
        this.emit('trajectory', this.trajectory)
        break
      case 'path':
        this.acceptPath(message)
        break
      case 'weeds':
        this.emit('weeds', { set: this.keepWeeds(message), gone: message.gone, all: false })
        break
      case 'events':
        this.log.push(...message.events)
        this.log.splice(0, this.log.length - LOG_LENGTH)
        this.emit('log', this.log)
        break
      case 'receiver':
        this.receiver = message
        this.emit('receiver', message)
        break
    }
  }

  private acceptPath({ first, points_map_m, rows }: PathPiece): void {
    const known: Path = first && this.path ? this.path : { points_map_m: [], rows: [] }
    this.path = {
      points_map_m: [...known.points_map_m.slice(0, first), ...points_map_m],
      rows: [...known.rows.slice(0, first), ...rows],
    }
    this.emit('path', this.path)
  }

  /** The plants that are new or different. */
  private keepWeeds({ set, gone }: WeedChanges): Weed[] {
    const weeds = set.map(readWeed)
    for (const weed of weeds) this.weeds.set(weed.id, weed)
    for (const id of gone) this.weeds.delete(id)
    this.counters.weeds = this.weeds.size
    return weeds
  }
}
