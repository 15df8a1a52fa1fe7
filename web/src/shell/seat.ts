/** The operator's seat: take it, hand it back, take it over from somebody. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'

/** Asks what to do with the seat; whether it was done. */
export async function chooseSeat(app: App): Promise<boolean> {
  const { store, dialogs } = app
  const name = el('input', {
    type: 'text',
    maxlength: 40,
    class: 'field-input',
    autocomplete: 'off',
    value: localStorage.getItem('operator') ?? '',
    placeholder: 'Your name',
  })
  const named = el('label', { class: 'field' }, el('span', {}, 'Name shown to the others'), name)
  if (app.session.role === 'viewer') {
    await dialogs.ask('Looking on', ['This address only lets you watch. STOP works all the same.'], [])
    return false
  }
  const mine = store.seat === 'you'
  const about = mine
    ? 'You operate the robot. Hand over so that another can.'
    : store.seat === 'other'
      ? `${store.holder || 'Another client'} operates the robot now. Taking over stops what is driven by hand.`
      : 'Nobody operates the robot. STOP works for everyone; every other command needs the seat.'
  const yes = mine ? 'Hand over' : store.seat === 'other' ? 'Take over' : 'Take control'
  const go = await dialogs.confirm(
    "Operator's seat",
    [el('p', {}, about), named],
    yes,
    store.seat === 'other' ? 'danger' : 'primary',
  )
  rename(app, name.value.trim())
  return go && app.command(mine ? { kind: 'leave_seat' } : { kind: 'take_seat', force: store.seat === 'other' })
}

function rename(app: App, name: string): void {
  if (name === (localStorage.getItem('operator') ?? '')) return
  localStorage.setItem('operator', name)
  app.link.send({ kind: 'use_name', name })
}

/** Takes the seat where nobody has it, and asks before it is taken over; whether this page has it then. */
export async function takeSeat(app: App): Promise<boolean> {
  const { seat } = app.store
  if (seat === 'you') return true
  return seat === 'free' && app.session.role === 'operator' ? app.command({ kind: 'take_seat' }) : chooseSeat(app)
}

/** A button that takes the seat where it is needed, and is hidden where you have it. */
export function seatButton(app: App): { node: HTMLElement; done: () => void } {
  const button = el('button', { type: 'button', class: 'button primary' }, 'Take control')
  button.addEventListener('click', () => void takeSeat(app))
  const update = (): void => {
    button.hidden = app.store.seat === 'you'
    button.textContent = app.store.seat === 'other' ? 'Take over' : 'Take control'
  }
  update()
  return { node: button, done: app.store.on('seat', update) }
}
