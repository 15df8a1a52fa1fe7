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
import { sessionCheck } from './shell/session-check.ts'
import { StatusBar } from './shell/statusbar.ts'
import { StopButton } from './shell/stop.ts'
import { startTheme } from './shell/theme.ts'
import { Toasts } from './shell/toasts.ts'
import { Store } from './store.ts'
import { installHooks } from './test-hooks.ts'
import type { SessionInfo } from './wire.ts'
import { say } from './say.ts'

const RETRY_MS = 1500
/** A login lasts for hours after what was asked last, and a page that only listens asks nothing. */
const RENEW_MS = 3_600_000

/** Asks until the robot answers who it is; what keeps it from that is said in the middle of the page. */
async function openSession(main: HTMLElement, logIn: () => Promise<void>): Promise<SessionInfo> {
  const problem = el('p', { class: 'boot', role: 'status' }, say('waitingForFirstAnswer'))
  main.append(problem)
  for (;;) {
    try {
      const session = await api.session()
      problem.textContent = ''
      if (!session.needs_login) {
        problem.remove()
        return session
      }
      await logIn()
    } catch (error) {
      if (error instanceof ApiError && error.status === 401) {
        problem.textContent = ''
        await logIn()
        continue
      }
      problem.textContent = say('tryingAgain', { problem: message(error) })
      await new Promise((resolve) => setTimeout(resolve, RETRY_MS))
    }
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

/** What needs no answer of the robot, STOP first: it is sent as soon as there is a line. */
function beginPage() {
  const store = new Store()
  const link = new Link(store)
  const main = el('main', { class: 'main', id: 'main' })
  const banners = new Banners(store, link, main)
  const top = el(
    'header',
    { class: 'statusbar' },
    el('div', { class: 'brand' }, el('b', { class: 'brand-name' }, 'AGRIBOT')),
  )
  const content = el('div', { class: 'content' }, banners.node, main)
  const heading = el('h1', { class: 'visually-hidden' }, say('agribotOperatorPage'))
  top.append(heading)
  const shell = el('div', { class: 'shell' }, top, content)
  document.body.append(shell)
  const toasts = new Toasts()
  const dialogs = new Dialogs(shell)
  const stop = new StopButton(link)
  link.onRefusal = (reason) => toasts.show('warn', reason || say('theRobotRefused'))
  link.onOutdated = () => location.reload()
  dialogs.onOpen = () => {
    toasts.raise()
    stop.raise()
  }
  link.start()
  const logIn = async (): Promise<void> => {
    link.rest() // a page without a token is turned away each time, and the robot notes it
    stop.hide() // and stops nothing
    await login(main)
    stop.raise()
    link.resume()
  }
  return { store, link, main, banners, heading, top, content, shell, toasts, dialogs, stop, logIn }
}

async function boot(): Promise<void> {
  startTheme()
  const page = beginPage()
  const { store, link, main, toasts } = page
  const session = await openSession(main, page.logIn)
  const off = new Set((new URLSearchParams(location.search).get('off') ?? '').split(','))
  const app = new App(store, link, session, toasts, page.dialogs, off)
  if (session.source === 'description') {
    link.rest()
    page.stop.remove()
    return showDescription(app, page.shell)
  }
  setInterval(() => void api.session().catch(() => undefined), RENEW_MS)
  store.setHasRobot(session.source !== 'replay')
  link.onUnopened = sessionCheck(link, api.session, () => location.reload())
  link.expect(session.run)
  page.banners.onRelease = () => void app.command({ kind: 'clear_stop' }, say('stopReleased'))
  const bar = new StatusBar(app).node
  bar.append(page.heading)
  page.top.replaceWith(bar)
  store.on('channel', () => void app.loadWorld())
  store.on('field', () => void app.loadWorld())
  tellRefusals(store, toasts)
  const extras = await api.panels().catch(() => [])
  const screens = extras.some((panel) => panel.kind !== 'layer' && panel.kind !== 'listener')
    ? [...SCREENS, panels]
    : SCREENS
  const router = new Router(app, screens, main)
  page.content.before(router.nav)
  installHooks(app, router)
  await app.loadWorld()
  await router.show()
}

void boot()
