/** Pad and keys, and everything that takes a hand off them. */

import type { TeleopMachine } from './machine.ts'
import { isDriveKey, keysInput, padInput } from './machine.ts'
import { isTextField } from '../shell/stop.ts'

/** A round pad driven by finger, pen or mouse: held only while pressed. */
export function listenPad(pad: HTMLElement, knob: HTMLElement, machine: TeleopMachine): void {
  let pointer: number | null = null
  const move = (event: PointerEvent): void => {
    const box = pad.getBoundingClientRect()
    const radius = box.width / 2
    const input = padInput(event.clientX - box.left - radius, event.clientY - box.top - radius, radius * 0.78)
    machine.hold('pad', input.forward, input.turn)
    if (machine.isArmed)
      knob.style.transform = `translate(${-input.turn * radius * 0.62}px, ${-input.forward * radius * 0.62}px)`
  }
  const end = (): void => {
    pointer = null
    knob.style.transform = ''
    pad.classList.remove('held')
    machine.release('pad')
  }
  pad.addEventListener('pointerdown', (event) => {
    if (pointer !== null || event.button !== 0) return
    pointer = event.pointerId
    pad.setPointerCapture(pointer)
    pad.classList.add('held')
    move(event)
  })
  pad.addEventListener('pointermove', (event) => {
    if (event.pointerId === pointer) move(event)
  })
  for (const name of ['pointerup', 'pointercancel', 'lostpointercapture'] as const) {
    pad.addEventListener(name, (event) => {
      if (event.pointerId === pointer) end()
    })
  }
  pad.addEventListener('contextmenu', (event) => event.preventDefault())
}

/** W A S D and the arrows, anywhere but in a text field or a slider. */
export function listenKeys(machine: TeleopMachine): () => void {
  const down = new Set<string>()
  const apply = (): void => {
    const { forward, turn } = keysInput(down)
    if (down.size) machine.hold('keys', forward, turn)
    else machine.release('keys')
  }
  const forget = (): void => {
    down.clear()
    machine.release('keys')
  }
  const press = (event: KeyboardEvent): void => {
    if (event.metaKey) forget() // a Mac does not report keys that are let go while it is held
    if (!isDriveKey(event.code) || event.ctrlKey || event.altKey || event.metaKey || isTextField(event.target)) return
    if (event.target instanceof HTMLInputElement || event.target instanceof HTMLSelectElement) return
    event.preventDefault()
    if (event.repeat) return
    down.add(event.code)
    apply()
  }
  const lift = (event: KeyboardEvent): void => {
    if (down.delete(event.code)) apply()
  }
  window.addEventListener('keydown', press)
  window.addEventListener('keyup', lift)
  window.addEventListener('blur', forget)
  return () => {
    window.removeEventListener('keydown', press)
    window.removeEventListener('keyup', lift)
    window.removeEventListener('blur', forget)
    forget()
  }
}

/** Leaving the window, hiding the tab and losing the link let go of everything. */
export function listenLeaving(letGo: () => void): () => void {
  const hidden = (): void => {
    if (document.hidden) letGo()
  }
  window.addEventListener('blur', letGo)
  window.addEventListener('pagehide', letGo)
  document.addEventListener('visibilitychange', hidden)
  return () => {
    window.removeEventListener('blur', letGo)
    window.removeEventListener('pagehide', letGo)
    document.removeEventListener('visibilitychange', hidden)
  }
}
