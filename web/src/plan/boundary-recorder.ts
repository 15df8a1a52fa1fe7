/** Records a boundary by driving around it. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import { distanceM } from '../geo.ts'
import { icon } from '../icons.ts'
import type { Vec2 } from '../wire.ts'
import { say } from '../say.ts'

const EVERY_M = 0.5
const FEWEST_POINTS = 3

export class BoundaryRecorder {
  readonly button: HTMLButtonElement
  private points: Vec2[] | null = null
  private readonly undo: () => void

  constructor(
    private readonly app: App,
    private readonly done: (points: Vec2[]) => void,
  ) {
    this.button = el(
      'button',
      { type: 'button', class: 'button tool', 'aria-pressed': 'false', onclick: () => this.toggle() },
      icon('teleop', 20),
      say('byDriving'),
    )
    this.undo = app.store.on('state', (state) => {
      if (state.pose) this.take([state.pose[0], state.pose[1]])
    })
  }

  private take(at: Vec2): void {
    if (!this.points) return
    const last = this.points[this.points.length - 1]
    if (!last || distanceM(last, at) >= EVERY_M) this.points.push(at)
  }

  private toggle(): void {
    const points = this.points
    this.points = points ? null : []
    this.button.setAttribute('aria-pressed', String(!points))
    if (!points) this.app.toasts.show('info', say('driveAlongEdge'))
    else if (points.length < FEWEST_POINTS) this.app.toasts.show('warn', say('tooShortForBoundary'))
    else this.done(points)
  }

  close(): void {
    this.undo()
  }
}
