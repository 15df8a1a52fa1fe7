/** The line that is always there: mode, link, age, position, battery, stop, operator, clients. */

import type { App } from '../app.ts'
import { el, setAttr, setText } from '../dom.ts'
import { fixed, fixName, metres, NONE } from '../format.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import { HAND_MS, LATE_MS } from '../link-monitor.ts'
import type { Store } from '../store.ts'
import type { Mode } from '../wire.ts'
import { chooseSeat } from './seat.ts'
import { showConnect } from './connect.ts'
import { onTheme, setTheme, theme, THEME_NAMES, THEMES } from './theme.ts'
import { say } from '../say.ts'

const UPDATE_MS = 200
export const MODE_NAMES: Record<Mode, string> = {
  mission: say('onMission'),
  paused: say('paused'),
  teleop: say('byHand'),
  stopped: say('stopped'),
  waiting: say('waiting'),
  done: say('modeDone'),
  replay: say('replay'),
}

class Chip {
  readonly node: HTMLElement
  private readonly value = el('span', { class: 'chip-value' }, NONE)

  constructor(name: IconName, label: string, action?: () => void) {
    this.node = el(
      action ? 'button' : 'div',
      { class: 'chip', title: label, ...(action ? { type: 'button', onclick: action } : {}) },
      icon(name, 20),
      el('span', { class: 'chip-label' }, label),
      this.value,
    )
  }

  set(text: string, tone: '' | 'good' | 'warn' | 'bad' = ''): void {
    setText(this.value, text)
    setAttr(this.node, 'data-tone', tone || null)
  }
}

export class StatusBar {
  readonly node: HTMLElement
  private readonly mode = el('span', { class: 'mode', 'data-mode': 'waiting' }, say('connecting'))
  private readonly link = new Chip('link', say('link'))
  private readonly age = new Chip('clock', say('age'))
  private readonly gnss = new Chip('satellite', say('gnss'))
  private readonly battery = new Chip('battery', say('battery'))
  private readonly stop = new Chip('stop', say('stop'))
  private readonly operator: Chip
  private readonly clients: Chip

  constructor(private readonly app: App) {
    this.operator = new Chip('person', say('operator'), () => void chooseSeat(app))
    this.operator.node.classList.add('operator')
    this.clients = new Chip('people', say('connected'), () => void showConnect(app))
    const chips = [this.link, this.age, this.gnss, this.battery, this.stop, this.clients]
    for (const part of [this.mode, this.gnss.node, this.battery.node, this.stop.node]) part.classList.add('of-robot')
    this.node = el(
      'header',
      { class: 'statusbar' },
      el('div', { class: 'brand' }, el('span', { class: 'brand-name' }, 'AGRIBOT'), this.mode, this.operator.node),
      el('div', { class: 'chips', role: 'group', 'aria-label': say('status') }, ...chips.map((chip) => chip.node)),
      themeButton(),
    )
    setInterval(() => this.update(), UPDATE_MS)
    app.store.on('seat', () => this.update())
    this.update()
  }

  private update(): void {
    const { store } = this.app
    const state = store.state
    const ageMs = store.ageMs(performance.now())
    this.node.classList.toggle('is-stale', store.stale)
    setText(this.mode, state ? (MODE_NAMES[state.mode] ?? state.mode) : say('connecting'))
    setAttr(this.mode, 'data-mode', state?.mode ?? 'waiting')
    this.link.set(linkText(store), linkTone(store))
    this.age.set(fixed(ageMs / 1000, 1, 's'), store.stale ? 'bad' : '')
    this.updatePosition()
    this.updateBattery()
    this.stop.set(state ? (state.stop ? say('stopPressed') : say('stopClear')) : NONE, state?.stop ? 'bad' : '')
    const holder = operatorText(store.seat, store.holder)
    this.operator.set(holder, store.seat === 'you' ? 'good' : '')
    setAttr(this.operator.node, 'title', say('operatorIs', { name: holder }))
    this.clients.set(String(store.clients))
  }

  private updatePosition(): void {
    const gnss = this.app.store.state?.gnss
    if (!gnss?.quality) {
      this.gnss.set(say('noFix'), 'bad')
      return
    }
    this.gnss.set(`${fixName(gnss.quality)} ${metres(gnss.std_m)}`, (gnss.std_m ?? 0) > 0.5 ? 'warn' : '')
  }

  private updateBattery(): void {
    const battery = this.app.store.state?.battery
    if (!battery) {
      this.battery.set(NONE)
      return
    }
    const pct = battery.charge_pct
    const text = pct === null ? fixed(battery.voltage_v, 1, 'V') : fixed(pct, 0, '%')
    this.battery.set(text, pct !== null && pct < 20 ? 'bad' : '')
  }
}

/** The time of an answer, of the one that is still missing where it is late already. */
function linkText({ linked, monitor }: Store): string {
  if (!linked) return say('linkDown')
  if (monitor.rttMs === null && monitor.roundTripMs <= LATE_MS) return NONE
  const ms = monitor.roundTripMs
  return ms < LATE_MS ? fixed(ms, 0, 'ms') : fixed(ms / 1000, 1, 's')
}

function linkTone({ answers, monitor }: Store): '' | 'good' | 'warn' | 'bad' {
  if (!answers) return 'bad'
  return monitor.roundTripMs > HAND_MS ? 'warn' : 'good'
}

function operatorText(seat: string, holder: string): string {
  if (seat === 'you') return say('you')
  if (seat === 'other') return holder || say('another')
  return say('noOperator')
}

function themeButton(): HTMLElement {
  const button = el('button', { type: 'button', class: 'icon-button quiet theme-button' }, icon('theme'))
  const name = (): void => {
    const label = say('themeIs', { name: THEME_NAMES[theme()] })
    button.title = label
    button.setAttribute('aria-label', label)
  }
  button.addEventListener('click', () => setTheme(THEMES[(THEMES.indexOf(theme()) + 1) % THEMES.length]))
  onTheme(name)
  name()
  return button
}
