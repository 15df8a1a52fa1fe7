/** What to do while the robot does not know in which direction it looks. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import type { State } from '../wire.ts'
import { say } from '../say.ts'

/** 1 sigma of a heading that may be any direction is pi, rad. */
const UNKNOWN_RAD = 3
/** What a magnetometer or two antennas take to know the heading of a robot that stands, s. */
const PATIENCE_S = 4

/** Since when of the robot's time there are positions and no heading; null where that is not so. */
export function findNoHeading(state: State | null, since_s: number | null): number | null {
  if (!state || state.mode === 'replay' || state.pose || !state.gnss) return null
  return (state.yaw_std_rad ?? 0) >= UNKNOWN_RAD ? (since_s ?? state.t_s) : null
}

/** Whether a person has to help: nothing on the robot knows its heading at standstill. */
export function needsWay(state: State | null, since_s: number | null): boolean {
  return state !== null && since_s !== null && state.t_s - since_s >= PATIENCE_S
}

export class HeadingCard {
  readonly node = el(
    'div',
    { class: 'card stack heading-card', role: 'status', hidden: true },
    el('h2', {}, say('noHeadingYet')),
    el('p', {}, say('driveForHeading')),
    el('a', { class: 'button primary', href: '#/teleop' }, say('driveByHand')),
  )
  private since_s: number | null = null

  constructor(private readonly app: App) {}

  update(): void {
    const { state } = this.app.store
    this.since_s = findNoHeading(state, this.since_s)
    this.node.hidden = !needsWay(state, this.since_s)
  }
}
