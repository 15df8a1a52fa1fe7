/** Whether the robot on the map looks otherwise than before: nothing is drawn anew for one that stands. */

import type { App } from '../app.ts'
import type { Vec2 } from '../wire.ts'

const PLACE_DIGITS = 3 // a millimetre, a fifth of a pixel in the closest view
const ANGLE_DIGITS = 4

export class RobotSight {
  private seen = ''
  private robot: App['robot'] = null

  constructor(private readonly app: App) {}

  /** Since the last time it was asked. */
  hasChanged(goal: Vec2 | null): boolean {
    const { robot, store } = this.app
    const { pose, pos_std_m, yaw_std_rad } = store.state ?? {}
    const places = [pose?.[0], pose?.[1], pos_std_m, goal?.[0], goal?.[1]]
    const angles = [pose?.[2], yaw_std_rad]
    const now = [
      ...places.map((value) => value?.toFixed(PLACE_DIGITS)),
      ...angles.map((value) => value?.toFixed(ANGLE_DIGITS)),
    ].join()
    const isOther = now !== this.seen || robot !== this.robot
    this.seen = now
    this.robot = robot
    return isOther
  }
}
