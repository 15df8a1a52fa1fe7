/** How well the robot answers, and what its clock shows. Every time is given in milliseconds; it reads no clock. */

export const PING_MS = 250
/** Beyond it an operator is warned: a slow answer, or an old state. */
export const LATE_MS = 1000
/** Time without an answer from which on the line is red: within a second of its last word. */
export const SILENT_MS = 700
/** The slowest line over which a hand may drive: what it lets go of, the robot hears half of it later. */
export const HAND_MS = 500
/** A line without an answer for as long is given up. */
export const DEAD_MS = 3000
/** Longest step of the clock that counts as waiting: in a longer one the page itself stood still. */
const AWAKE_STEP_MS = 250
/** A longer step is the sleep of the device, not the work of the page. */
const ASLEEP_STEP_MS = 10_000
/** For how long it counts that the page stood still, and how much of that makes it slow. */
const STOOD_KEPT_MS = 5000
const SLOW_MS = 1000
const SAMPLES_MS = 30_000
const CLOCK_JUMP_MS = 50

interface Sample {
  atMs: number
  rttMs: number
  offsetMs: number
}

export class LinkMonitor {
  /** Of the last ping that was answered, while this page was awake; null before the first. */
  rttMs: number | null = null
  /** The robot's clock of the day less its steady one, for what is stamped with the former. */
  private wallLessMonoMs = 0
  private samples: Sample[] = []
  private isNew = true
  private unanswered: { c: number; awakeMs: number }[] = []
  private awakeMs = 0
  private lastMs: number | null = null
  private stood: { atMs: number; ms: number }[] = []

  /** Another connection: its first answer replaces what was known of the clock. */
  open(nowMs: number): void {
    this.rttMs = null
    this.unanswered = []
    this.isNew = true
    this.tick(nowMs)
  }

  tick(nowMs: number): void {
    const stepMs = nowMs - (this.lastMs ?? nowMs)
    this.awakeMs += Math.min(stepMs, AWAKE_STEP_MS)
    this.lastMs = nowMs
    this.stood = this.stood.filter(({ atMs }) => nowMs - atMs < STOOD_KEPT_MS)
    if (stepMs > AWAKE_STEP_MS && stepMs < ASLEEP_STEP_MS) this.stood.push({ atMs: nowMs, ms: stepMs - AWAKE_STEP_MS })
  }

  /** Whether this page has stood still of late: its device is too slow for what is drawn. */
  get isPageSlow(): boolean {
    return this.stood.reduce((sum, { ms }) => sum + ms, 0) > SLOW_MS
  }

  sent(c: number): void {
    this.tick(c)
    this.unanswered.push({ c, awakeMs: this.awakeMs })
  }

  pong(c: number, monoMs: number, wallMs: number, nowMs: number): void {
    this.tick(nowMs)
    const ping = this.unanswered.find((each) => each.c === c)
    this.unanswered = this.unanswered.filter((each) => each.c > c)
    this.rttMs = ping ? this.awakeMs - ping.awakeMs : nowMs - c
    this.wallLessMonoMs = wallMs - monoMs
    const sample = { atMs: nowMs, rttMs: nowMs - c, offsetMs: monoMs - (c + nowMs) / 2 }
    const best = this.best
    const hasJumped =
      best !== null && Math.abs(sample.offsetMs - best.offsetMs) > (sample.rttMs + best.rttMs) / 2 + CLOCK_JUMP_MS
    if (this.isNew || hasJumped) this.samples = []
    this.isNew = false
    this.samples = [...this.samples.filter(({ atMs }) => nowMs - atMs < SAMPLES_MS), sample]
  }

  /** How long the oldest ping waits for its answer, while this page was awake. */
  get unansweredMs(): number {
    return this.unanswered.length ? this.awakeMs - this.unanswered[0].awakeMs : 0
  }

  /** The time of an answer now: of the last one, or of that which is still missing if it is longer. */
  get roundTripMs(): number {
    return Math.max(this.rttMs ?? 0, this.unansweredMs)
  }

  /** Whether the robot answers in time. */
  get answers(): boolean {
    return this.unansweredMs <= SILENT_MS && (this.rttMs ?? 0) <= LATE_MS
  }

  /** The robot's steady clock now; null before the first answer. */
  robotMs(nowMs: number): number | null {
    const best = this.best
    return best && nowMs + best.offsetMs
  }

  /** How old is what the robot stamped with its steady clock; infinite before the first answer. */
  ageMs(monoMs: number, nowMs: number): number {
    const robotMs = this.robotMs(nowMs)
    return robotMs === null ? Infinity : Math.max(0, robotMs - monoMs)
  }

  ageOfWallMs(wallMs: number, nowMs: number): number {
    return this.ageMs(wallMs - this.wallLessMonoMs, nowMs)
  }

  /** The quickest answer shows the clock best: it is wrong by half of its time at most. */
  private get best(): Sample | null {
    return this.samples.reduce<Sample | null>(
      (best, sample) => (best && best.rttMs <= sample.rttMs ? best : sample),
      null,
    )
  }
}
