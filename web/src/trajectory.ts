import { distanceM } from './geo.ts'
import type { Vec2 } from './wire.ts'

const JOINED_WITHIN_M = 1

/** The points the server numbered; a gap (points this client never got) starts a new piece. */
export class Trajectory {
  pieces: Vec2[][] = []
  next = 0
  revision = 0

  restart(first: number, points: Vec2[]): void {
    this.pieces = points.length ? [points.slice()] : []
    this.next = first + points.length
    this.revision++
  }

  extend(first: number, points: Vec2[]): void {
    const known = this.next - first
    if (known < 0 || !this.pieces.length) this.pieces.push(points.slice())
    else this.pieces[this.pieces.length - 1].push(...points.slice(known))
    this.next = Math.max(this.next, first + points.length)
  }

  get length(): number {
    return this.pieces.reduce((sum, piece) => sum + piece.length, 0)
  }
}

/** The end of the track as far as the robot, unless it is farther on: a slow line brings states before the track. */
export function joinRobot(tail: Vec2[], robot: Vec2): Vec2[] {
  const last = tail[tail.length - 1]
  return last && distanceM(last, robot) <= JOINED_WITHIN_M ? [...tail, robot] : tail
}
