/** What every screen is given. */

import { api, message } from './api.ts'
import { Projection } from './geo.ts'
import type { Link } from './link.ts'
import { HAND_MS } from './link-monitor.ts'
import type { Dialogs } from './shell/dialogs.ts'
import type { Toasts } from './shell/toasts.ts'
import type { Store } from './store.ts'
import type { Field, PageRequest, Robot, SessionInfo } from './wire.ts'
import type { IconName } from './icons.ts'
import { say } from './say.ts'

export class App {
  field: Field | null = null
  projection = new Projection({ lat_deg: 0, lon_deg: 0 })
  robot: Robot | null = null
  private readonly fieldListeners = new Set<() => void>()
  private asked = 0
  private loading: Promise<void> | null = null

  constructor(
    readonly store: Store,
    readonly link: Link,
    readonly session: SessionInfo,
    readonly toasts: Toasts,
    readonly dialogs: Dialogs,
    /** Parts switched off by `?off=map,scene`, for machines without WebGL. */
    readonly off: ReadonlySet<string>,
  ) {}

  /** Field and robot of what is shown now; asked for once more where that changes on their way. */
  loadWorld(): Promise<void> {
    this.asked++
    this.loading ??= this.load().finally(() => (this.loading = null))
    return this.loading
  }

  private async load(): Promise<void> {
    for (;;) {
      const {
        asked,
        store: { channel: shown },
      } = this
      const [field, robot] = await Promise.allSettled([
        api.field(shown?.source === 'replay' ? shown.name : null),
        api.robot(),
      ])
      if (asked !== this.asked) continue
      if (robot.status === 'fulfilled') this.robot = robot.value
      else this.toasts.show('warn', message(robot.reason))
      if (field.status === 'fulfilled') this.setField(field.value)
      else this.toasts.show('warn', message(field.reason))
      return
    }
  }

  private setField(field: Field): void {
    this.field = field
    this.projection = new Projection(field.datum)
    for (const listener of this.fieldListeners) listener()
  }

  /** Called now, if the field is known, and whenever it changes. */
  onField(listener: () => void): () => void {
    this.fieldListeners.add(listener)
    if (this.field) listener()
    return () => this.fieldListeners.delete(listener)
  }

  /** Send a command; a refusal is shown with the robot's reason. True when the robot did it. */
  async command(command: PageRequest, done = ''): Promise<boolean> {
    const ack = await this.link.command(command)
    if (!ack.ok) this.toasts.show('warn', ack.reason || say('theRobotRefused'))
    else if (done) this.toasts.show('info', done)
    return ack.ok
  }

  /** Run a request; a failure is shown. Null when it failed. */
  async attempt<T>(work: Promise<T>): Promise<T | null> {
    try {
      return await work
    } catch (error) {
      this.toasts.show('warn', message(error))
      return null
    }
  }

  get mayCommand(): boolean {
    return this.store.seat === 'you' && this.store.linked && this.store.state?.mode !== 'replay'
  }

  /** Whether what a hand does here reaches the robot soon enough to drive it. */
  get mayDriveByHand(): boolean {
    const { store } = this
    return this.mayCommand && !store.stale && store.answers && store.monitor.roundTripMs <= HAND_MS
  }
}

export interface Screen {
  id: string
  title: string
  icon: IconName
  /** Fill the host; the result undoes timers and subscriptions. */
  mount(host: HTMLElement, app: App): (() => void) | Promise<() => void>
}
