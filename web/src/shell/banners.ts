/** What must not be missed: old data, a lost link, a pressed STOP, a replay. */

import type { App } from '../app.ts'
import { el, setText } from '../dom.ts'
import { icon } from '../icons.ts'

export class Banners {
  readonly node: HTMLElement
  private readonly stale = el('div', { class: 'banner bad', role: 'alert', hidden: true })
  private readonly staleText = el('span')
  private readonly stopped = el('div', { class: 'banner bad', role: 'alert', hidden: true })
  private readonly stoppedText = el('span')
  private readonly release = el('button', { type: 'button', class: 'button' }, 'Release stop')
  private readonly replay = el('div', { class: 'banner note', hidden: true }, icon('recordings', 20),
    el('span', {}, 'Replay: nothing here commands the robot.'),
    el('a', { href: '#/recordings', class: 'button' }, 'Recordings'))

  constructor(private readonly app: App, private readonly main: HTMLElement) {
    this.stale.append(icon('warning', 20), this.staleText)
    this.stopped.append(icon('stop', 20), this.stoppedText, this.release)
    this.node = el('div', { class: 'banners' }, this.stale, this.stopped, this.replay)
    this.release.addEventListener('click', () => void app.command({ k: 'clear_stop' }, 'Stop released.'))
    setInterval(() => this.update(), 200)
    app.store.on('stale', () => this.update())
    app.store.on('link', () => this.update())
  }

  private update(): void {
    const { store } = this.app
    const state = store.state
    this.main.classList.toggle('is-stale', store.stale)
    this.stale.hidden = !store.stale
    if (store.stale) setText(this.staleText, this.staleReason())
    const stopped = Boolean(state?.stop) && state?.mode !== 'replay'
    this.stopped.hidden = !stopped
    if (stopped) setText(this.stoppedText, `Stopped: ${state?.stop ?? ''}`)
    this.release.hidden = store.seat !== 'you'
    this.replay.hidden = state?.mode !== 'replay'
    this.main.classList.toggle('is-replay', state?.mode === 'replay')
  }

  private staleReason(): string {
    const { store, link } = this.app
    const ageS = Math.floor(store.ageMs(performance.now()) / 1000)
    const old = Number.isFinite(ageS) ? `What you see is ${ageS} s old. ` : ''
    if (!store.linked) return `${old}${link.farewell || 'No link to the robot, trying again…'}`
    return old ? `${old}The robot sends nothing.` : 'Waiting for the first data of the robot…'
  }
}
