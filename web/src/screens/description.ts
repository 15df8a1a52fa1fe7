/** The robot alone, of `agribot describe --ui`: nothing runs, nothing is linked, nothing to stop. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import { robot } from './robot.ts'

export async function showDescription(app: App, shell: HTMLElement): Promise<void> {
  const main = el('main', { class: 'main', id: 'main' })
  shell.classList.add('only-robot')
  shell.replaceChildren(main)
  await app.loadWorld()
  const name = app.robot?.name ?? 'robot'
  document.title = `${name} · AGRIBOT`
  const host = el('section', { class: 'screen screen-robot', 'aria-label': name })
  main.append(el('h1', { class: 'visually-hidden' }, name), host)
  await robot.mount(host, app)
}
