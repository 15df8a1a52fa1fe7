import './styles/tokens.css'
import './styles/base.css'
import './styles/shell.css'
import './styles/controls.css'
import './styles/screens.css'
import { api, ApiError, message } from './api.ts'
import { App } from './app.ts'
import { el } from './dom.ts'
import { Link } from './link.ts'
import { showDescription } from './screens/description.ts'
import { SCREENS } from './screens/index.ts'
import { panels } from './screens/panels.ts'
import { Banners } from './shell/banners.ts'
import { Dialogs } from './shell/dialogs.ts'
import { login } from './shell/login.ts'
import { Router } from './shell/router.ts'
import { StatusBar } from './shell/statusbar.ts'
import { StopButton } from './shell/stop.ts'
import { startTheme } from './shell/theme.ts'
import { Toasts } from './shell/toasts.ts'
import { Store } from './store.ts'
import { installHooks } from './test-hooks.ts'
import type { SessionInfo } from './wire.ts'

const RETRY_MS = 1500

async function openSession(): Promise<SessionInfo> {
  const problem = el('p', { class: 'boot', role: 'status' })
  for (;;) {
    try {
      const session = await api.session()
      if (!session.needs_login) {
        problem.remove()
        return session
      }
      await login()
    } catch (error) {
      if (error instanceof ApiError && error.status === 401) {
        await login()
        continue
      }
      problem.textContent = `${message(error)} Trying again…`
      if (!problem.isConnected) document.body.append(problem)
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS))
    }
  }
}

/** Loads the page anew where another run answers by now, or one that wants a login and does not tell. */
function sessionCheck(run: number): () => void {
  let isAsking = false
  return () => {
    if (isAsking) return
    isAsking = true
    api
      .session()
      .then(
        (now) => now.run !== run && location.reload(),
        () => undefined,
      )
      .finally(() => (isAsking = false))
  }
}

/** What the mission refuses only after a while, such as a goal for which the robot had to stop first. */
function tellRefusals(store: Store, toasts: Toasts): void {
  let told: string | undefined
  store.on('state', (state) => {
    const refusal = state.mission?.refusal ?? ''
    if (refusal && told !== undefined && refusal !== told) toasts.show('warn', refusal)
    told = refusal
  })
}

async function boot(): Promise<void> {
  startTheme()
  const session = await openSession()
  if (session.source === 'description') return showDescription(session)
  const store = new Store()
  store.hasRobot = session.source !== 'replay'
  const link = new Link(store, session.run)
  const shell = el('div', { class: 'shell' })
  document.body.append(shell)
  const toasts = new Toasts()
  const dialogs = new Dialogs(shell)
  const stop = new StopButton(link)
  link.onRefusal = (reason) => toasts.show('warn', reason || 'The robot refused.')
  link.onUnopened = sessionCheck(session.run)
  link.onOutdated = () => location.reload()
  dialogs.onOpen = () => {
    toasts.raise()
    stop.raise()
  }
  const off = new Set((new URLSearchParams(location.search).get('off') ?? '').split(','))
  const app = new App(store, link, session, toasts, dialogs, off)
  const main = el('main', { class: 'main', id: 'main' })
  const content = el('div', { class: 'content' }, new Banners(app, main).node, main)
  shell.append(el('h1', { class: 'visually-hidden' }, 'AGRIBOT operator page'), new StatusBar(app).node, content)
  store.on('channel', () => void app.loadWorld())
  store.on('field', () => void app.loadWorld())
  tellRefusals(store, toasts)
  link.start() // whatever the screens still have to ask for, STOP and what it needs are there by now
  const extras = await api.panels().catch(() => [])
  const screens = extras.some((panel) => panel.kind !== 'layer' && panel.kind !== 'listener')
    ? [...SCREENS, panels]
    : SCREENS
  const router = new Router(app, screens, main)
  content.before(router.nav)
  installHooks(app, router)
  await app.loadWorld()
  await router.show()
}

void boot()
