/** What a program added to the page from Python: plots, forms, pictures, buttons. Its layers are on the map. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el } from '../dom.ts'
import { quantity } from '../format.ts'
import { fieldsOf, readField } from '../panels/form.ts'
import type { FormSchema, NamedField } from '../panels/form.ts'
import { Chart } from '../plots/chart.ts'
import type { PanelInfo, SettingValue } from '../wire.ts'
import { say } from '../say.ts'

const PLOT_WINDOW_S = 60
const PLOT_EVERY_MS = 100

export const panels: Screen = {
  id: 'panels',
  title: say('extras'),
  icon: 'more',
  async mount(host, app) {
    const column = el('div', { class: 'panel-grid' })
    host.append(column)
    const found = (await app.attempt(api.panels())) ?? []
    const undo = found
      .filter((panel) => panel.kind !== 'layer' && panel.kind !== 'listener')
      .map((panel) => {
        const card = el('section', { class: 'card stack' }, el('h2', {}, panel.title))
        column.append(card)
        return fill(card, panel, app)
      })
    if (!undo.length) column.append(el('p', { class: 'card empty' }, say('noExtras')))
    return () => undo.forEach((work) => work())
  },
}

function fill(card: HTMLElement, panel: PanelInfo, app: App): () => void {
  if (panel.kind === 'plot') return plot(card, panel, app)
  if (panel.kind === 'image') return picture(card, panel)
  if (panel.kind === 'form') card.append(form(panel, app))
  else
    card.append(
      el(
        'button',
        { type: 'button', class: 'button primary', onclick: () => void submit(panel, {}, app) },
        panel.title,
      ),
    )
  return () => undefined
}

async function submit(panel: PanelInfo, values: Record<string, SettingValue>, app: App): Promise<void> {
  const answer = await app.attempt(api.submitPanel(panel.id, values))
  if (!answer) return
  const { text } = (await answer.json()) as { text?: string }
  app.toasts.show('info', text || say('isDone'))
}

function form(panel: PanelInfo, app: App): HTMLElement {
  const fields = fieldsOf((panel.schema ?? {}) as FormSchema).map((field) => {
    const input = makeInput(field)
    const about = field.description ? el('span', {}, field.description) : null
    return {
      field,
      input,
      node: el('label', { class: 'field' }, el('span', {}, field.title ?? quantity(field.name)), input, about),
    }
  })
  const node = el(
    'form',
    { class: 'stack-tight wide' },
    ...fields.map((f) => f.node),
    el('button', { class: 'button primary', type: 'submit' }, say('send')),
  )
  node.addEventListener('submit', (event) => {
    event.preventDefault()
    void submit(
      panel,
      Object.fromEntries(fields.map(({ field, input }) => [field.name, readField(field, input.value, input.checked)])),
      app,
    )
  })
  return node
}

function makeInput(field: NamedField): HTMLInputElement {
  const isNumber = field.type === 'number' || field.type === 'integer'
  const isBoolean = field.type === 'boolean'
  return el('input', {
    type: isBoolean ? 'checkbox' : isNumber ? 'number' : 'text',
    class: isBoolean ? '' : 'field-input',
    step: field.type === 'number' ? 'any' : null,
    min: field.minimum,
    max: field.maximum,
    required: field.required && !isBoolean,
    checked: field.default === true,
    value: field.default === undefined ? '' : String(field.default),
  })
}

function picture(card: HTMLElement, panel: PanelInfo): () => void {
  const image = el('img', { class: 'panel-image', alt: panel.title })
  card.append(image)
  const load = (): void => {
    image.src = `/api/v1/panels/${encodeURIComponent(panel.id)}?at=${Date.now()}`
  }
  load()
  const timer = setInterval(load, (panel.refresh_s ?? 1) * 1000)
  return () => clearInterval(timer)
}

function plot(card: HTMLElement, panel: PanelInfo, app: App): () => void {
  const { signals } = app.store
  const indices = (panel.fields ?? []).map((name) => signals.names.indexOf(name)).filter((i) => i >= 0)
  const box = el('div', { class: 'panel-plot' })
  card.append(box)
  const chart = new Chart(
    box,
    signals.units[indices[0]] ?? '',
    indices,
    indices.map((i) => quantity(signals.names[i])),
    { key: 'panels' },
  )
  const timer = setInterval(() => chart.draw(app.store.signals, PLOT_WINDOW_S, null), PLOT_EVERY_MS)
  return () => {
    clearInterval(timer)
    chart.close()
  }
}
