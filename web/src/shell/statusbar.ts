/** The line that is always there: mode, link, age, position, battery, stop, operator, clients. */

import type { App } from '../app.ts'
import { el, setAttr, setText } from '../dom.ts'
import { fixName, metres, NONE } from '../format.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import { HAND_MS, LATE_MS } from '../link-monitor.ts'
import type { Store } from '../store.ts'
import type { Mode } from '../wire.ts'
import { chooseSeat } from './seat.ts'
import { showConnect } from './connect.ts'
import { onTheme, setTheme, theme, THEME_NAMES, THEMES } from './theme.ts'

const UPDATE_MS = 200
export const MODE_NAMES: Record<Mode, string> = {
  mission: 'On mission',
  paused: 'Paused',
  teleop: 'By hand',
  stopped: 'Stopped',
  waiting: 'Waiting',
  done: 'Done',
  replay: 'Replay',
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
  private readonly mode = el('span', { class: 'mode', 'data-mode': 'waiting' }, 'Connecting')
  private readonly link = new Chip('link', 'Link')
  private readonly age = new Chip('clock', 'Age')
  private readonly gnss = new Chip('satellite', 'GNSS')
  private readonly battery = new Chip('battery', 'Battery')
  private readonly stop = new Chip('stop', 'Stop')
  private readonly operator: Chip
  private readonly clients: Chip

  constructor(private readonly app: App) {
    this.operator = new Chip('person', 'Operator', () => void chooseSeat(app))
    this.operator.node.classList.add('operator')
    this.clients = new Chip('people', 'Connected', () => void showConnect(app))
    const chips = [this.link, this.age, this.gnss, this.battery, this.stop, this.clients]
    for (const part of [this.mode, this.gnss.node, this.battery.node, this.stop.node]) part.classList.add('of-robot')
    this.node = el(
      'header',
      { class: 'statusbar' },
      el('div', { class: 'brand' }, el('span', { class: 'brand-name' }, 'AGRIBOT'), this.mode, this.operator.node),
      el('div', { class: 'chips', role: 'group', 'aria-label': 'Status' }, ...chips.map((chip) => chip.node)),
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
    setText(this.mode, state ? (MODE_NAMES[state.mode] ?? state.mode) : 'Connecting')
    setAttr(this.mode, 'data-mode', state?.mode ?? 'waiting')
    this.link.set(linkText(store), linkTone(store))
    this.age.set(Number.isFinite(ageMs) ? `${(ageMs / 1000).toFixed(1)} s` : NONE, store.stale ? 'bad' : '')
    this.updatePosition()
    this.updateBattery()
    this.stop.set(state ? (state.stop ? 'Pressed' : 'Clear') : NONE, state?.stop ? 'bad' : '')
    const holder = operatorText(store.seat, store.holder)
    this.operator.set(holder, store.seat === 'you' ? 'good' : '')
    setAttr(this.operator.node, 'title', `Operator: ${holder}`)
    this.clients.set(String(store.clients))
  }

  private updatePosition(): void {
    const gnss = this.app.store.state?.gnss
    if (!gnss?.quality) {
      this.gnss.set('No fix', 'bad')
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
    const text = pct === null ? `${battery.voltage_v.toFixed(1)} V` : `${pct.toFixed(0)} %`
    this.battery.set(text, pct !== null && pct < 20 ? 'bad' : '')
  }
}

/** The time of an answer, of the one that is still missing where it is late already. */
function linkText({ linked, monitor }: Store): string {
  if (!linked) return 'Down'
  if (monitor.rttMs === null && monitor.roundTripMs <= LATE_MS) return NONE
  const ms = monitor.roundTripMs
  return ms < LATE_MS ? `${ms.toFixed(0)} ms` : `${(ms / 1000).toFixed(1)} s`
}

function linkTone({ answers, monitor }: Store): '' | 'good' | 'warn' | 'bad' {
  if (!answers) return 'bad'
  return monitor.roundTripMs > HAND_MS ? 'warn' : 'good'
}

function operatorText(seat: string, holder: string): string {
  if (seat === 'you') return 'You'
  if (seat === 'other') return holder || 'Another'
  return 'Nobody'
}

function themeButton(): HTMLElement {
  const button = el('button', { type: 'button', class: 'icon-button quiet theme-button' }, icon('theme'))
  const name = (): void => {
    const label = `Theme: ${THEME_NAMES[theme()]}. Change`
    button.title = label
    button.setAttribute('aria-label', label)
  }
  button.addEventListener('click', () => setTheme(THEMES[(THEMES.indexOf(theme()) + 1) % THEMES.length]))
  onTheme(name)
  name()
  return button
}
