/** Is everything well, what runs how fast, what happened, and a bundle to send when asking for help. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el, replace } from '../dom.ts'
import { bytes, duration, fixed, NONE, words } from '../format.ts'
import { icon } from '../icons.ts'
import type { Health, HealthCheck, LogEvent } from '../wire.ts'
import { GnssCard } from './gnss-card.ts'
import { GraphCard } from './graph-card.ts'
import { langOf, named, say } from '../say.ts'

const REFRESH_MS = 2000
const SLOW = 0.8
const LOG_ROWS = 200
/** Kinds of events whose text comes in the page's language. */
const OF_FACTS = new Set(['fault', 'stop', 'hold', 'limit'])

export const health: Screen = {
  id: 'health',
  title: say('screenHealth'),
  icon: 'health',
  async mount(host, app) {
    const checks = el('div', { class: 'checks-grid' })
    const gnss = new GnssCard(app)
    const graph = new GraphCard()
    const rates = el('div', { class: 'card table-card' })
    const machine = el('p', { class: 'muted' })
    const log = el('div', { class: 'card log', role: 'log', 'aria-label': say('log'), tabindex: 0 })
    host.append(
      el(
        'div',
        { class: 'column wide' },
        el(
          'div',
          { class: 'card row-card' },
          el('div', {}, el('h2', {}, say('screenHealth')), machine),
          el(
            'a',
            { class: 'button', href: '/api/v1/support.zip', download: '' },
            icon('download', 20),
            say('supportBundle'),
          ),
        ),
        checks,
        gnss.node,
        el('div', { class: 'halves' }, rates, log),
        graph.node,
      ),
    )
    const refresh = async (): Promise<void> => {
      const found = await api.health().catch(() => null)
      if (!found) return
      const cpu = fixed(found.cpu_ratio === null ? null : found.cpu_ratio * 100, 0, '%')
      const memory = bytes(found.memory_bytes)
      machine.textContent = say('machineLine', { cpu, memory, version: app.session.version })
      replace(checks, ...found.checks.map(checkCard))
      replace(rates, rateTable(found))
    }
    const showLog = (): void => replace(log, el('h2', {}, say('log')), ...logRows(app))
    showLog()
    gnss.update()
    const undo = [app.store.on('log', showLog), app.store.on('receiver', () => gnss.update())]
    const timer = setInterval(() => void refresh(), REFRESH_MS)
    await refresh()
    return () => {
      clearInterval(timer)
      graph.close()
      for (const work of undo) work()
    }
  },
}

function checkCard(check: HealthCheck): HTMLElement {
  const value = typeof check.value === 'string' ? check.value : '' // the text says what a bare number means
  return el(
    'div',
    { class: `card check-card ${check.state}` },
    el(
      'div',
      { class: 'check-head' },
      icon(check.state === 'ok' ? 'check' : 'warning', 20),
      el('h3', { lang: langOf(check.name) }, words(check.name)),
      el('span', { class: 'value' }, value),
    ),
    el('p', {}, check.text),
    check.advice !== '' && el('p', { class: 'advice' }, check.advice),
  )
}

function rateTable(found: Health): HTMLElement {
  const rows = found.rates.map((rate) => {
    const slow = rate.expected_hz !== null && (rate.measured_hz ?? 0) < SLOW * rate.expected_hz
    return el(
      'tr',
      {},
      el('td', { lang: langOf(rate.topic) }, rate.topic),
      el('td', { class: 'number' }, fixed(rate.expected_hz, 0)),
      el('td', { class: `number ${slow ? 'slow' : ''}` }, fixed(rate.measured_hz, 1)),
    )
  })
  return el(
    'table',
    {},
    el(
      'thead',
      {},
      el(
        'tr',
        {},
        el('th', {}, say('topicName')),
        el('th', { class: 'number' }, say('expectedHz')),
        el('th', { class: 'number' }, say('measuredHz')),
      ),
    ),
    el('tbody', {}, ...rows),
  )
}

function logRows(app: App): HTMLElement[] {
  if (!app.store.log.length) return [el('p', { class: 'muted' }, say('nothingHappenedYet'))]
  return app.store.log.slice(-LOG_ROWS).reverse().map(logRow)
}

function logRow(event: LogEvent): HTMLElement {
  const isOfFact = event.state !== '' || OF_FACTS.has(event.source)
  const text = named(event.text)
  return el(
    'div',
    { class: `log-row ${event.level}` },
    el('span', { class: 'mono muted' }, duration(event.t_s)),
    el('span', { class: 'log-source' }, named(event.source) || NONE),
    el('span', { lang: isOfFact ? null : langOf(event.text) }, event.state ? `${words(event.state)}: ${text}` : text),
  )
}
