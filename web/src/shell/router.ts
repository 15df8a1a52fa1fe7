/** One screen at a time, named in the address, so that a refresh comes back to it. */

import type { App, Screen } from '../app.ts'
import { el } from '../dom.ts'
import { icon } from '../icons.ts'
import { say } from '../say.ts'

const ON_PHONE = 4

export class Router {
  readonly nav: HTMLElement
  current = ''
  private undo: () => void = () => undefined
  private turn = 0

  constructor(
    private readonly app: App,
    private readonly screens: Screen[],
    private readonly main: HTMLElement,
  ) {
    const links = screens.map((screen, i) =>
      el(
        'a',
        {
          href: `#/${screen.id}`,
          class: i < ON_PHONE ? 'tab' : 'tab rest',
          'data-screen': screen.id,
          title: screen.title,
        },
        icon(screen.icon),
        el('span', {}, screen.title),
      ),
    )
    const more = el('button', { type: 'button', class: 'tab more' }, icon('more'), el('span', {}, say('more')))
    more.addEventListener('click', () => void this.showRest())
    this.nav = el('nav', { class: 'rail', 'aria-label': say('screens') }, ...links, more)
    window.addEventListener('hashchange', () => void this.show())
  }

  async show(): Promise<void> {
    const wanted = location.hash.replace(/^#\//, '')
    const screen = this.screens.find((s) => s.id === wanted) ?? this.screens[0]
    if (screen.id === this.current) return
    const turn = ++this.turn
    this.undo()
    this.undo = () => undefined
    this.current = screen.id
    document.title = `${screen.title} · AGRIBOT`
    this.markCurrent(screen)
    const host = el('section', { class: `screen screen-${screen.id}`, 'aria-label': screen.title })
    this.main.replaceChildren(host)
    const undo = await screen.mount(host, this.app)
    if (turn === this.turn) this.undo = undo
    else undo() // another screen was opened while this one loaded
  }

  private markCurrent(screen: Screen): void {
    let inBar = false
    for (const link of this.nav.querySelectorAll<HTMLElement>('a.tab')) {
      const here = link.dataset.screen === screen.id
      if (here) link.setAttribute('aria-current', 'page')
      else link.removeAttribute('aria-current')
      inBar ||= here && !link.classList.contains('rest')
    }
    this.nav.querySelector('.more')?.classList.toggle('current', !inBar)
  }

  private async showRest(): Promise<void> {
    const list = el('div', { class: 'more-list' })
    const answer = this.app.dialogs.ask<string>(say('screens'), [list], [])
    for (const screen of this.screens.slice(ON_PHONE)) {
      list.append(
        el(
          'a',
          {
            href: `#/${screen.id}`,
            class: 'tab',
            onclick: () => list.closest('.dialog')?.querySelector<HTMLElement>('header button')?.click(),
          },
          icon(screen.icon),
          el('span', {}, screen.title),
        ),
      )
    }
    await answer
  }
}
