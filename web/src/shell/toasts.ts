/** Short messages that leave by themselves; read out by a screen reader. */

import { el } from '../dom.ts'
import { icon } from '../icons.ts'
import type { EventLevel } from '../wire.ts'
import { say } from '../say.ts'

const STAY_MS: Record<EventLevel, number> = { info: 4000, warn: 8000, fault: 12000 }
const MOST = 4

export class Toasts {
  private readonly box = el('div', {
    class: 'toasts',
    role: 'log',
    'aria-live': 'polite',
    'aria-label': say('messages'),
    popover: 'manual',
  })

  constructor() {
    document.body.append(this.box)
    this.box.showPopover()
  }

  raise(): void {
    this.box.hidePopover()
    this.box.showPopover()
  }

  /** What is still to be read is not said twice. */
  show(level: EventLevel, text: string): void {
    if ([...this.box.children].some((toast) => toast.textContent === text)) return
    const close = el(
      'button',
      { type: 'button', class: 'icon-button quiet', 'aria-label': say('dismiss') },
      icon('cancel', 18),
    )
    const toast = el(
      'div',
      { class: `toast ${level}` },
      icon(level === 'info' ? 'check' : 'warning', 20),
      el('span', {}, text),
      close,
    )
    close.addEventListener('click', () => toast.remove())
    this.box.append(toast)
    while (this.box.children.length > MOST) this.box.firstElementChild?.remove()
    setTimeout(() => toast.remove(), STAY_MS[level])
  }
}
