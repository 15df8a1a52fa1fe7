/** What the map stays on, as mapviz's target frame: the ground, or the robot in one of three ways. */

import type { Map as MapLibre } from 'maplibre-gl'
import type { App } from '../app.ts'
import { RAD } from '../geo.ts'
import { say } from '../say.ts'

export const TARGETS = {
  map: say('theMap'),
  near: say('robotKeptInView'),
  position: say('robotInTheMiddle'),
  heading: say('robotHeadingUp'),
}
export type Target = keyof typeof TARGETS

/** How far from the middle the followed robot may go, as a share of the map's size. */
const KEEP_WITHIN = 0.36
/** What the events of a move after the robot carry. */
export const FOLLOWING = { isFollowing: true }
const NEAR_PX = 0.5
const NEAR_DEG = 0.2

/** The map that is moved. */
interface TrackedMap {
  readonly app: App
  readonly map: MapLibre
  readonly node: HTMLElement
  /** Whether the canvas is as large as the map's place on the page. */
  readonly isFilled: boolean
  /** The part of the earth that stays in view until somebody moves the map. */
  fitted: unknown
  /** Bring all of the field into view again, if that is what is shown. */
  refit(): boolean
  remember(): void
}

export class Tracking {
  target: Target = 'near'
  /** What is up in the map besides the robot's heading, degrees clockwise. */
  turnDeg = 0
  onTarget: () => void = () => undefined
  private onRobot: Target = 'near'

  constructor(private readonly view: TrackedMap) {}

  choose(target: Target): void {
    if (this.target === target) return
    this.set(target)
    this.follow()
    this.view.remember()
  }

  /** Between the map and the robot as it was last followed. */
  toggle(): void {
    this.choose(this.target === 'map' ? this.onRobot : 'map')
  }

  /** Without moving the map. */
  set(target: Target, turnDeg = this.turnDeg): void {
    this.target = target
    this.turnDeg = turnDeg
    if (target !== 'map') this.onRobot = target
    if (target === 'position' || target === 'heading') this.view.fitted = null
    this.onTarget()
  }

  /** Target and turn as another program has them: without the heading, the turn is that of the map. */
  take(target: Target, turnDeg: number): void {
    const { view } = this
    this.set(target, target === 'heading' ? turnDeg : 0)
    if (target !== 'heading') view.map.jumpTo({ bearing: turnDeg })
    this.follow()
    view.remember()
  }

  told(): { target: Target; turn: number } {
    const bearing = (Math.round(this.view.map.getBearing() / 90) * 90 + 360) % 360
    return { target: this.target, turn: this.target === 'heading' ? this.turnDeg : bearing }
  }

  /** A quarter of a turn clockwise. */
  turn(): void {
    const { view } = this
    view.fitted = null
    if (this.target === 'heading') {
      this.turnDeg = (this.turnDeg + 90) % 360
      this.follow()
      view.remember()
    } else view.map.easeTo({ bearing: view.map.getBearing() + 90 })
  }

  /** Go after the robot; where it is only kept in view, when it leaves the middle part of the map. */
  follow(): void {
    const { view, target } = this
    const pose = view.app.store.state?.pose
    if (!pose || target === 'map' || view.map.isMoving() || !view.node.isConnected || !view.isFilled) return
    const at = view.app.projection.toLonLat(pose[0], pose[1])
    const { x, y } = view.map.project(at)
    const { clientWidth: w, clientHeight: h } = view.node
    const [dx, dy] = [Math.abs(x - w / 2), Math.abs(y - h / 2)]
    if (target !== 'near') {
      const bearing = target === 'heading' ? 90 - pose[2] / RAD + this.turnDeg : view.map.getBearing()
      const off = Math.abs(((bearing - view.map.getBearing() + 540) % 360) - 180)
      if (dx > NEAR_PX || dy > NEAR_PX || off > NEAR_DEG) view.map.jumpTo({ center: at, bearing }, FOLLOWING)
      return
    }
    const within = view.fitted ? 0.5 : KEEP_WITHIN // the whole field is in view: do not move it without need
    if (dx <= w * within && dy <= h * within) return
    if (!view.refit()) view.map.easeTo({ center: at, duration: 600 }, FOLLOWING)
  }
}
