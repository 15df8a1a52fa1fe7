/** The robot alone, of `agribot describe --ui`: nothing runs, nothing is linked, nothing to stop. */

import { App } from '../app.ts'
import { el } from '../dom.ts'
import { Link } from '../link.ts'
import { robot } from './robot.ts'
import { Store } from '../store.ts'
import type { SessionInfo } from '../wire.ts'
import { Dialogs } from '../shell/dialogs.ts'
import { Toasts } from '../shell/toasts.ts'

export async function showDescription(session: SessionInfo): Promise<void> {
  const main = el('main', { class: 'main', id: 'main' })
  const shell = el('div', { class: 'shell only-robot' }, main)
  document.body.append(shell)
  const store = new Store()
  const off = new Set((new URLSearchParams(location.search).get('off') ?? '').split(','))
  const app = new App(store, new Link(store, session.run), session, new Toasts(), new Dialogs(shell), off)
  await app.loadWorld()
  const name = app.robot?.name ?? 'robot'
  document.title = `${name} · AGRIBOT`
  const host = el('section', { class: 'screen screen-robot', 'aria-label': name })
  main.append(el('h1', { class: 'visually-hidden' }, name), host)
  await robot.mount(host, app)
}
