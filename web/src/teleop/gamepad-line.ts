/** The line about the gamepad below the pad: its name, and the axes of one that is not known. */

import { el, setText } from '../dom.ts'
import type { Assignment, Pad } from './gamepad.ts'
import { assignmentOf, choosePad, PadAssigner, parseAssignment, readPad } from './gamepad.ts'
import type { TeleopMachine } from './machine.ts'
import { say } from '../say.ts'

const keyOf = (pad: Pad): string => `gamepad ${pad.id}`

export class GamepadLine {
  private readonly words = el('span', { class: 'muted', role: 'status' })
  private readonly button = el(
    'button',
    { type: 'button', class: 'button', hidden: true, onclick: () => this.toggle() },
    say('assignItsAxes'),
  )
  readonly node = el('div', { class: 'gamepad-line' }, this.words, this.button)
  private assigner: PadAssigner | null = null
  private readonly known = new Map<string, Assignment | null>()

  /** Reads the pad once: it drives only while its dead-man button is held. */
  tick(machine: TeleopMachine): void {
    const pad = choosePad(navigator.getGamepads?.() ?? [])
    if (!pad) this.assigner = null
    const assigned = pad && this.find(pad)
    const assignment = pad && assignmentOf(pad, assigned)
    const input = pad && assignment && !this.assigner ? readPad(pad, assignment) : null
    if (input) machine.hold('gamepad', input.forward, input.turn)
    else machine.release('gamepad')
    if (pad && this.assigner) this.keep(pad, this.assigner.take(pad))
    setText(this.words, pad ? this.textOf(pad, assignment) : '')
    this.button.hidden = !pad || pad.mapping === 'standard'
    setText(this.button, this.assigner ? say('cancel') : assigned ? say('assignItsAxesAnew') : say('assignItsAxes'))
  }

  private toggle(): void {
    this.assigner = this.assigner ? null : new PadAssigner()
  }

  private find(pad: Pad): Assignment | null {
    const key = keyOf(pad)
    if (!this.known.has(key)) this.known.set(key, parseAssignment(localStorage.getItem(key)))
    return this.known.get(key) ?? null
  }

  private keep(pad: Pad, assignment: Assignment | null): void {
    if (!assignment) return
    localStorage.setItem(keyOf(pad), JSON.stringify(assignment))
    this.known.set(keyOf(pad), assignment)
    this.assigner = null
  }

  private textOf(pad: Pad, assignment: Assignment | null): string {
    if (this.assigner) return this.assigner.text
    const name = pad.id.slice(0, 40)
    return say(assignment ? 'gamepadIs' : 'gamepadUnknown', { name })
  }
}
