/** The operator's seat: take it, hand it back, take it over from somebody. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import { say } from '../say.ts'

/** Asks what to do with the seat; whether it was done. */
export async function chooseSeat(app: App): Promise<boolean> {
  const { store, dialogs } = app
  const name = el('input', {
    type: 'text',
    maxlength: 40,
    class: 'field-input',
    autocomplete: 'off',
    value: localStorage.getItem('operator') ?? '',
    placeholder: say('yourName'),
  })
  const named = el('label', { class: 'field' }, el('span', {}, say('nameForOthers')), name)
  if (app.session.role === 'viewer') {
    await dialogs.ask(say('lookingOn'), [say('onlyWatching')], [])
    return false
  }
  const mine = store.seat === 'you'
  const about = mine
    ? say('seatIsYours')
    : store.seat === 'other'
      ? say('seatIsTaken', { holder: store.holder || say('anotherClient') })
      : say('seatIsFree')
  const yes = mine ? say('handOver') : store.seat === 'other' ? say('takeOver') : say('takeControl')
  const go = await dialogs.confirm(
    say('operatorsSeat'),
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

/** Takes the seat where it is free, and asks before it is taken over; whether this page has it then. */
export async function takeSeat(app: App): Promise<boolean> {
  const { seat } = app.store
  if (seat === 'you') return true
  return seat === 'free' && app.session.role === 'operator' ? app.command({ kind: 'take_seat' }) : chooseSeat(app)
}

/** A button that takes the seat where it is needed, and is hidden where you have it. */
export function seatButton(app: App): { node: HTMLElement; done: () => void } {
  const button = el('button', { type: 'button', class: 'button primary' }, say('takeControl'))
  button.addEventListener('click', () => void takeSeat(app))
  const update = (): void => {
    button.hidden = app.store.seat === 'you'
    button.textContent = app.store.seat === 'other' ? say('takeOver') : say('takeControl')
  }
  update()
  return { node: button, done: app.store.on('seat', update) }
}
