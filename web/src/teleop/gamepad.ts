/** Which axes and buttons of a gamepad drive: those of the standard, or those that somebody assigned. No DOM. */

import { withoutDeadZone } from './machine.ts'
import { say } from '../say.ts'

/** What is read of a browser's Gamepad. */
export interface Pad {
  readonly id: string
  readonly mapping: string
  readonly connected: boolean
  readonly axes: readonly number[]
  readonly buttons: readonly { readonly pressed: boolean }[]
}

/** An axis, and the sign that makes forward or left positive. */
export interface AxisUse {
  axis: number
  sign: number
}

export interface Assignment {
  forward: AxisUse
  turn: AxisUse
  /** Any of these buttons has to be held. */
  deadMan: number[]
}

export interface Input {
  forward: number
  turn: number
}

// Axes and buttons of https://www.w3.org/TR/gamepad/#remapping: either shoulder, left and right stick.
const STANDARD: Assignment = {
  forward: { axis: 1, sign: -1 },
  turn: { axis: 2, sign: -1 },
  deadMan: [4, 5, 6, 7],
}
const REST = 0.25 // of an axis that may drive: triggers and hats rest elsewhere
const MOVED = 0.6 // from its rest, of an axis that is shown
const STILL_TICKS = 6

/** The first connected device that has axes and buttons; one of a known layout before others. */
export function choosePad(pads: readonly (Pad | null)[]): Pad | null {
  const usable = pads.filter((pad): pad is Pad => !!pad?.connected && pad.axes.length > 1 && pad.buttons.length > 0)
  return usable.find((pad) => pad.mapping === 'standard') ?? usable[0] ?? null
}

/** What drives on a pad; null: its layout is not known, and nothing does. */
export function assignmentOf(pad: Pad, assigned: Assignment | null): Assignment | null {
  if (assigned) return assigned
  if (pad.mapping !== 'standard') return null
  return pad.axes.length > 2 ? STANDARD : { ...STANDARD, turn: { axis: 0, sign: -1 } }
}

/** What the hand wants, in shares of the limits; null unless the dead-man button is held. */
export function readPad(pad: Pad, assignment: Assignment): Input | null {
  if (!assignment.deadMan.some((button) => pad.buttons[button]?.pressed)) return null
  return { forward: readAxis(pad, assignment.forward), turn: readAxis(pad, assignment.turn) }
}

function readAxis(pad: Pad, use: AxisUse): number {
  const value = pad.axes[use.axis] ?? 0
  return Number.isFinite(value) ? use.sign * withoutDeadZone(Math.max(-1, Math.min(1, value))) + 0 : 0
}

/** Reads an assignment that was kept as text; null for anything else. */
export function parseAssignment(text: string | null): Assignment | null {
  try {
    const { forward, turn, deadMan } = JSON.parse(text ?? 'null') as Assignment
    const uses = [forward, turn].every((use) => isNumber(use.axis) && Math.abs(use.sign) === 1)
    return uses && deadMan.length > 0 && deadMan.every(isNumber) ? { forward, turn, deadMan } : null
  } catch {
    return null
  }
}

function isNumber(value: unknown): boolean {
  return Number.isInteger(value) && (value as number) >= 0
}

const STEPS = {
  rest: say('letGoOfAll'),
  forward: say('pushForwardStick'),
  left: say('pushTurnStick'),
  deadMan: say('pressHeldButton'),
} as const

/** Asks step by step what drives; call `take` with what the pad shows, again and again. */
export class PadAssigner {
  private step: keyof typeof STEPS = 'rest'
  private rest: number[] = []
  private stillTicks = 0
  private forward: AxisUse | null = null
  private pushed: AxisUse | null = null
  private turn: AxisUse | null = null

  get text(): string {
    return this.pushed ? say('nowLetItGo') : STEPS[this.step]
  }

  /** Returns the assignment once all of it was shown. */
  take(pad: Pad): Assignment | null {
    if (this.step === 'rest') this.takeRest(pad)
    else if (this.step === 'deadMan') return this.takeButton(pad)
    else this.takeStick(pad)
    return null
  }

  private takeRest(pad: Pad): void {
    const isStill =
      !pad.buttons.some((button) => button.pressed) && this.rest.every((at, i) => near(pad.axes[i], at, 0.1))
    this.stillTicks = isStill ? this.stillTicks + 1 : 0
    if (!isStill || this.rest.length !== pad.axes.length) this.rest = [...pad.axes]
    if (this.stillTicks > STILL_TICKS) this.step = 'forward'
  }

  private takeStick(pad: Pad): void {
    if (this.pushed) {
      if (!near(pad.axes[this.pushed.axis], this.rest[this.pushed.axis] ?? 0, REST)) return
      if (this.step === 'forward') this.forward = this.pushed
      else this.turn = this.pushed
      this.step = this.step === 'forward' ? 'left' : 'deadMan'
      this.pushed = null
      return
    }
    const axis = pad.axes.findIndex((value, i) => this.mayDrive(i) && Math.abs(value - (this.rest[i] ?? 0)) > MOVED)
    if (axis >= 0) this.pushed = { axis, sign: Math.sign(pad.axes[axis] ?? 1) }
  }

  private mayDrive(axis: number): boolean {
    return axis !== this.forward?.axis && Math.abs(this.rest[axis] ?? 1) < REST
  }

  private takeButton(pad: Pad): Assignment | null {
    const button = pad.buttons.findIndex((one) => one.pressed)
    if (button < 0 || !this.forward || !this.turn) return null
    return { forward: this.forward, turn: this.turn, deadMan: [button] }
  }
}

function near(value: number | undefined, at: number, by: number): boolean {
  return value !== undefined && Math.abs(value - at) < by
}
