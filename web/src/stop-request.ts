/** A STOP that was pressed, until the robot says that it stands under it. It reads no clock. */

export class StopRequest {
  private pressedMs: number | null = null
  private isHeard = false
  private isSeen = false

  /** Every press asks anew. */
  press(nowMs: number): void {
    this.pressedMs = nowMs
    this.repeat()
  }

  /** Another line: what was heard over the old one may have ended with the robot's program. */
  repeat(): void {
    this.isHeard = this.isSeen = false
  }

  /** The server has it. Where no robot runs, that is all that can be said. */
  hear(hasRobot: boolean): void {
    this.isHeard = true
    if (!hasRobot) this.isSeen = true
    this.settle()
  }

  /** The robot says whether a stop holds it. */
  see(isStopped: boolean): void {
    if (this.pressedMs !== null && isStopped) this.isSeen = true
    this.settle()
  }

  /** The server has not got it yet. */
  get isUnheard(): boolean {
    return this.isPending && !this.isHeard
  }

  get isPending(): boolean {
    return this.pressedMs !== null
  }

  waitedMs(nowMs: number): number {
    return this.pressedMs === null ? 0 : nowMs - this.pressedMs
  }

  private settle(): void {
    if (this.isHeard && this.isSeen) this.pressedMs = null
  }
}
