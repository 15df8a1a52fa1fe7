/** Any numeric signal over the last seconds to minutes. */

import type uPlot from 'uplot'
import type { App, Screen } from '../app.ts'
import { download, el, replace } from '../dom.ts'
import { quantity } from '../format.ts'
import { icon } from '../icons.ts'
import { toCsv } from '../plots/buffer.ts'
import { Chart } from '../plots/chart.ts'
import { say } from '../say.ts'

const WINDOWS_S = [10, 30, 60, 300, 600]
const DRAW_EVERY_MS = 66
const CHOSEN_AT_FIRST = 3
const KEY = 'plot-signals'

export const plots: Screen = {
  id: 'plots',
  title: say('screenPlots'),
  icon: 'plots',
  mount(host, app) {
    const charts = el('div', { class: 'charts' })
    const chosen = new Set<string>(
      (JSON.parse(localStorage.getItem(KEY) ?? 'null') as string[] | null) ??
        app.store.signals.names.slice(0, CHOSEN_AT_FIRST),
    )
    const panel = new PlotPanel(app, charts, chosen)
    host.append(charts, el('div', { class: 'side' }, panel.tools, panel.signals))
    panel.rebuild()
    const undo = app.store.on('signals', () => panel.rebuildIfRenamed())
    const timer = setInterval(() => panel.draw(), DRAW_EVERY_MS)
    return () => {
      undo()
      clearInterval(timer)
      panel.close()
    }
  },
}

/** One chart per unit, so that metres and volts do not share an axis. */
class PlotPanel {
  readonly tools: HTMLElement
  readonly signals = el('div', { class: 'card stack', role: 'group', 'aria-label': say('signals') })
  private charts: Chart[] = []
  private windowS = 30
  private pausedAtS: number | null = null
  private names = ''
  private readonly sync = { key: 'plots' } satisfies uPlot.Cursor.Sync

  constructor(
    private readonly app: App,
    private readonly host: HTMLElement,
    private readonly chosen: Set<string>,
  ) {
    const pause = el(
      'button',
      {
        type: 'button',
        class: 'button',
        'aria-pressed': 'false',
        onclick: () => {
          this.pausedAtS = this.pausedAtS === null ? app.store.signals.lastS : null
          pause.setAttribute('aria-pressed', String(this.pausedAtS !== null))
        },
      },
      icon('pause', 20),
      say('pause'),
    )
    const length = el(
      'select',
      { onchange: () => (this.windowS = Number(length.value)) },
      ...WINDOWS_S.map((s) =>
        el('option', { value: s, selected: s === this.windowS }, s < 60 ? `${s} s` : `${s / 60} min`),
      ),
    )
    this.tools = el(
      'div',
      { class: 'card stack' },
      el('label', { class: 'field' }, el('span', {}, say('window')), length),
      el(
        'div',
        { class: 'button-row' },
        pause,
        el('button', { type: 'button', class: 'button', onclick: () => this.saveCsv() }, icon('download', 20), 'CSV'),
      ),
    )
  }

  rebuildIfRenamed(): void {
    if (this.app.store.signals.names.join() !== this.names) this.rebuild()
  }

  rebuild(): void {
    const { names, units } = this.app.store.signals
    this.names = names.join()
    if (names.length && ![...this.chosen].some((name) => names.includes(name)))
      for (const name of names.slice(0, CHOSEN_AT_FIRST)) this.chosen.add(name)
    replace(this.signals, el('h2', {}, say('signals')), ...names.map((name, i) => this.toggle(name, units[i])))
    this.close()
    const groups = new Map<string, number[]>()
    names.forEach((name, i) => {
      if (this.chosen.has(name)) groups.set(units[i], [...(groups.get(units[i]) ?? []), i])
    })
    if (!groups.size)
      replace(
        this.host,
        el('p', { class: 'card empty' }, names.length ? say('chooseSignalsToDraw') : say('noSignalsYet')),
      )
    else this.host.replaceChildren()
    this.charts = [...groups].map(
      ([unit, indices]) =>
        new Chart(
          this.host,
          unit,
          indices,
          indices.map((i) => quantity(names[i])),
          this.sync,
        ),
    )
  }

  private toggle(name: string, unit: string): HTMLElement {
    const box = el('input', {
      type: 'checkbox',
      checked: this.chosen.has(name),
      onchange: () => {
        if (box.checked) this.chosen.add(name)
        else this.chosen.delete(name)
        localStorage.setItem(KEY, JSON.stringify([...this.chosen]))
        this.rebuild()
        this.signals.querySelectorAll<HTMLInputElement>('input')[this.app.store.signals.names.indexOf(name)]?.focus()
      },
    })
    return el(
      'label',
      { class: 'check' },
      box,
      el('span', {}, quantity(name)),
      unit !== '' && el('span', { class: 'muted' }, unit),
    )
  }

  draw(): void {
    for (const chart of this.charts) chart.draw(this.app.store.signals, this.windowS, this.pausedAtS)
  }

  private saveCsv(): void {
    const { signals } = this.app.store
    const indices = signals.names.map((_, i) => i).filter((i) => this.chosen.has(signals.names[i]))
    const columns = signals.window(indices, this.windowS, this.pausedAtS ?? signals.lastS)
    const header = [
      't_s',
      ...indices.map((i) => (signals.units[i] ? `${signals.names[i]} [${signals.units[i]}]` : signals.names[i])),
    ]
    download('signals.csv', toCsv(header, columns))
  }

  close(): void {
    for (const chart of this.charts) chart.close()
    this.charts = []
  }
}
