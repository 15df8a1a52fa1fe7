/** Dialogs in the top layer that leave STOP usable: the page behind is inert, STOP is not behind. */

import { el } from '../dom.ts'
import { icon } from '../icons.ts'
import { say } from '../say.ts'

export interface Choice<T> {
  label: string
  value: T
  kind?: 'primary' | 'danger'
}

export class Dialogs {
  /** Called after a dialog opened, to bring STOP and the messages above it. */
  onOpen: () => void = () => undefined
  /** Those that are open, the newest last. */
  private readonly layers: HTMLElement[] = []
  private count = 0

  constructor(private readonly behind: HTMLElement) {}

  /** Show a dialog; resolves to the choice made, or to null when it was dismissed. */
  ask<T>(title: string, body: (Node | string)[], choices: Choice<T>[]): Promise<T | null> {
    return new Promise((resolve) => {
      const returnTo = document.activeElement
      const close = (value: T | null): void => {
        layer.hidePopover()
        layer.remove()
        this.layers.splice(this.layers.indexOf(layer), 1)
        this.behind.inert = this.layers.length > 0
        window.removeEventListener('keydown', onKey)
        if (returnTo instanceof HTMLElement) returnTo.focus()
        resolve(value)
      }
      const onKey = (event: KeyboardEvent): void => {
        if (event.key === 'Escape' && this.layers.at(-1) === layer) close(null)
      }
      const actions = choices.map((choice) =>
        el(
          'button',
          { type: 'button', class: `button ${choice.kind ?? ''}`, onclick: () => close(choice.value) },
          choice.label,
        ),
      )
      const dismiss = el(
        'button',
        { type: 'button', class: 'icon-button quiet', 'aria-label': say('close'), onclick: () => close(null) },
        icon('cancel'),
      )
      const name = `dialog-${++this.count}`
      const panel = el(
        'div',
        { class: 'dialog', role: 'dialog', 'aria-labelledby': name },
        el('header', {}, el('h2', { id: name }, title), dismiss),
        el('div', { class: 'dialog-body' }, ...body),
        choices.length > 0 && el('footer', {}, ...actions),
      )
      const layer = el('div', { class: 'dialog-layer', popover: 'manual' }, panel)
      window.addEventListener('keydown', onKey) // of the window: a tap on the text leaves no focus
      layer.addEventListener('pointerdown', (event) => {
        if (event.target === layer) close(null)
      })
      document.body.append(layer)
      this.layers.push(layer)
      this.behind.inert = true
      layer.showPopover()
      this.onOpen()
      ;(panel.querySelector<HTMLElement>('input, select, footer .button:last-child') ?? dismiss).focus()
    })
  }

  async confirm(
    title: string,
    body: (Node | string)[],
    yes: string,
    kind: 'primary' | 'danger' = 'primary',
  ): Promise<boolean> {
    const answer = await this.ask(title, body, [
      { label: say('cancel'), value: false },
      { label: yes, value: true, kind },
    ])
    return answer === true
  }

  /** Ask for one of several names; null when dismissed. */
  async pick(title: string, about: string, names: string[], yes: string): Promise<string | null> {
    const options = names.map((value) => el('option', { value }, value))
    const select = el('select', { class: 'field-input', 'aria-label': title }, ...options)
    const answer = await this.ask(
      title,
      [el('p', {}, about), select],
      [
        { label: say('cancel'), value: false },
        { label: yes, value: true, kind: 'primary' },
      ],
    )
    return answer === true ? select.value : null
  }

  /** Ask for one line of text; null when dismissed or left empty. */
  async prompt(title: string, label: string, value = '', yes = say('save')): Promise<string | null> {
    const input = el('input', { type: 'text', value, maxlength: 80, class: 'field-input', autocomplete: 'off' })
    const body = el('label', { class: 'field' }, el('span', {}, label), input)
    const answer = this.ask(
      title,
      [body],
      [
        { label: say('cancel'), value: false },
        { label: yes, value: true, kind: 'primary' },
      ],
    )
    input.select()
    input.addEventListener('keydown', (event) => {
      if (event.key !== 'Enter') return
      event.preventDefault() // else the key presses the button that gets the focus back, too
      input.closest('.dialog')?.querySelector<HTMLElement>('footer .primary')?.click()
    })
    return (await answer) === true ? input.value.trim() || null : null
  }
}
