/** Which input drives, how fast, and when the robot must be stopped. No clock, no DOM. */

export type Source = 'pad' | 'keys' | 'gamepad'
export interface Drive {
  v: number
  w: number
}
export interface Limits {
  speedMps: number
  yawRateRadps: number
}

export const SCALES = [0.2, 0.5, 0.8, 1] as const
const ZERO: Drive = { v: 0, w: 0 }

/** Inputs are shares of the limits: forward and turn (left positive), each in [-1, 1]. */
export class TeleopMachine {
  private readonly held = new Map<Source, { forward: number; turn: number }>()
  /** Held while that had no effect: no effect either until let go. */
  private readonly blocked = new Set<Source>()
  private moving = false
  private armed = false

  /** Arming with an input held does nothing until that input was let go once. */
  setArmed(armed: boolean): void {
    if (armed === this.armed) return
    this.armed = armed
    this.releaseAll()
  }

  get isArmed(): boolean {
    return this.armed
  }

  /** Takes the input of a source that is held now; ignored unless armed. */
  hold(source: Source, forward: number, turn: number): void {
    if (!this.armed) this.blocked.add(source)
    if (this.blocked.has(source)) return
    this.held.set(source, { forward: clamp(forward), turn: clamp(turn) })
  }

  release(source: Source): void {
    this.held.delete(source)
    this.blocked.delete(source)
  }

  /** Stop now; whatever is still held must be let go before it drives again. */
  releaseAll(): void {
    for (const source of this.held.keys()) this.blocked.add(source)
    this.held.clear()
  }

  /** Something is held that has no effect until it is let go and held again. */
  get isHeldInVain(): boolean {
    return this.blocked.size > 0 && this.held.size === 0
  }

  /** The command to send in this tick, or null for silence. Letting go gives exactly one zero. */
  tick(limits: Limits): Drive | null {
    const input = this.armed ? this.first() : undefined
    if (!input && !this.moving) return null
    this.moving = input !== undefined
    if (!input) return ZERO
    return { v: input.forward * limits.speedMps, w: input.turn * limits.yawRateRadps }
  }

  private first(): { forward: number; turn: number } | undefined {
    return this.held.get('pad') ?? this.held.get('keys') ?? this.held.get('gamepad')
  }
}

function clamp(value: number): number {
  return Number.isFinite(value) ? Math.max(-1, Math.min(1, value)) : 0
}

const KEYS: Record<string, [forward: number, turn: number]> = {
  ArrowUp: [1, 0],
  KeyW: [1, 0],
  ArrowDown: [-1, 0],
  KeyS: [-1, 0],
  ArrowLeft: [0, 1],
  KeyA: [0, 1],
  ArrowRight: [0, -1],
  KeyD: [0, -1],
}

export function isDriveKey(code: string): boolean {
  return code in KEYS
}

/** The sum of the keys held down; opposite keys cancel. */
export function keysInput(codes: Iterable<string>): { forward: number; turn: number } {
  let forward = 0
  let turn = 0
  for (const code of codes) {
    forward += KEYS[code]?.[0] ?? 0
    turn += KEYS[code]?.[1] ?? 0
  }
  return { forward: clamp(forward), turn: clamp(turn) }
}

const DEAD_ZONE = 0.12

/** A stick axis without the play around its middle, still reaching ±1. */
export function withoutDeadZone(value: number): number {
  const size = Math.abs(value)
  if (size < DEAD_ZONE) return 0
  return (Math.sign(value) * Math.min(1, size - DEAD_ZONE)) / (1 - DEAD_ZONE)
}

/** A point of a round pad (pixels from its middle) as input. Up is forward, left turns left. */
export function padInput(dxPx: number, dyPx: number, radiusPx: number): { forward: number; turn: number } {
  const length = Math.hypot(dxPx, dyPx) / radiusPx
  const by = length > 1 ? 1 / length : 1
  return { forward: (-dyPx / radiusPx) * by, turn: (-dxPx / radiusPx) * by }
}
