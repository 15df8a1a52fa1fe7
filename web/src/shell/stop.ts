/** STOP: in the browser's top layer, above dialogs, on every screen; anybody may press it. */

import { el } from '../dom.ts'
import { icon } from '../icons.ts'
import type { Link } from '../link.ts'
import { say } from '../say.ts'

const TEXT_INPUTS = new Set(['text', 'search', 'url', 'email', 'password', 'number', 'tel', 'date', 'time', ''])

/** True where Space belongs to typing. */
export function isTextField(target: EventTarget | null): boolean {
  if (!(target instanceof HTMLElement)) return false
  if (target.isContentEditable || target instanceof HTMLTextAreaElement) return true
  return target instanceof HTMLInputElement && TEXT_INPUTS.has(target.getAttribute('type') ?? '')
}

export class StopButton {
  private readonly button: HTMLButtonElement

  constructor(private readonly link: Link) {
    this.button = el(
      'button',
      {
        id: 'stop',
        class: 'stop',
        type: 'button',
        popover: 'manual',
        title: say('stopTitle'),
      },
      icon('stop'),
      say('stopButton'),
    )
    this.button.addEventListener('pointerdown', () => this.stop())
    this.button.addEventListener('click', (event) => {
      if (event.detail === 0) this.stop() // keyboard and screen reader; a pointer has stopped already
    })
    document.body.append(this.button)
    this.raise()
    for (const name of ['resize', 'scroll']) window.visualViewport?.addEventListener(name, () => this.stay())
    window.addEventListener('keydown', (event) => this.onKey(event, true), true)
    window.addEventListener('keyup', (event) => this.onKey(event, false), true)
  }

  /** Put the button on top of everything that entered the top layer before. */
  raise(): void {
    this.button.hidden = false
    if (this.button.matches(':popover-open')) this.button.hidePopover()
    this.button.showPopover()
  }

  /** Where a press would stop nothing; Space is an ordinary key again. */
  hide(): void {
    this.button.hidden = true
  }

  /** Where there is no robot to stop. */
  remove(): void {
    this.hide()
    this.button.remove()
  }

  /** A page that is pinched larger shows a part of itself only: the button stays in it, as large as before. */
  private stay(): void {
    const seen = window.visualViewport
    if (!seen) return
    const { scale, offsetLeft, offsetTop, width } = seen
    const right = offsetLeft + width - document.documentElement.clientWidth
    this.button.style.transform =
      scale === 1 && !offsetTop ? '' : `translate(${right}px, ${offsetTop}px) scale(${1 / scale})`
  }

  private stop(): void {
    this.link.stop()
    this.button.classList.add('pressed')
    setTimeout(() => this.button.classList.remove('pressed'), 300)
  }

  private onKey(event: KeyboardEvent, down: boolean): void {
    if (this.button.hidden || event.code !== 'Space' || isTextField(event.target)) return
    event.preventDefault()
    event.stopPropagation()
    if (down && !event.repeat) this.stop()
  }
}
