/** The buttons on the map: zoom, follow, overview, layers, tools, picture, saved views. */

import { api } from '../api.ts'
import type { App } from '../app.ts'
import { download, el, setText } from '../dom.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import type { LayerGroup } from './layers.ts'
import { TOOLS } from './tools.ts'
import type { ToolId } from './tools.ts'
import type { SavedView, MapView } from './view.ts'

function mapButton(name: IconName, title: string, action: () => void): HTMLButtonElement {
  return el('button', { type: 'button', class: 'map-button', title, 'aria-label': title, onclick: action }, icon(name))
}

/** Which tools a screen offers; all by default. */
export function mapControls(view: MapView, app: App, tools: ToolId[] = TOOLS.map((t) => t.id)): { node: HTMLElement; done: () => void } {
  const follow = mapButton('follow', 'Follow the robot', () => view.setFollow(!view.follow))
  const layers = layerPanel(view)
  const layersButton = mapButton('layers', 'Layers and views', () => {
    layers.hidden = !layers.hidden
    layersButton.setAttribute('aria-expanded', String(!layers.hidden))
  })
  layersButton.setAttribute('aria-expanded', 'false')
  const hint = el('output', { class: 'map-hint select-all', hidden: true })
  const bar = toolBar(view, tools, hint)
  view.onFollow = () => follow.setAttribute('aria-pressed', String(view.follow))
  view.onFollow()
  const node = el('div', { class: 'map-controls' },
    el('div', { class: 'map-stack' },
      mapButton('plus', 'Zoom in', () => view.map.zoomIn()), mapButton('minus', 'Zoom out', () => view.map.zoomOut()),
      follow, mapButton('fit', 'Whole field', () => view.overview()), layersButton,
      mapButton('image', 'Save a picture of the map', () => void savePicture(view, app))),
    bar, layers, hint)
  return { node, done: () => view.tools.choose('pan') }
}

function toolBar(view: MapView, wanted: ToolId[], hint: HTMLElement): HTMLElement {
  const buttons = TOOLS.filter((tool) => wanted.includes(tool.id)).map((tool) => {
    const button = mapButton(tool.icon, tool.title, () => choose(view.tools.tool === tool.id ? 'pan' : tool.id))
    button.dataset.tool = tool.id
    return button
  })
  const choose = (id: ToolId): void => {
    view.tools.choose(id)
    for (const button of buttons) button.setAttribute('aria-pressed', String(button.dataset.tool === id))
  }
  view.tools.onText = (text) => {
    setText(hint, text)
    hint.hidden = !text
  }
  choose('pan')
  return el('div', { class: 'map-tools', role: 'toolbar', 'aria-label': 'Map tools' }, ...buttons)
}

async function savePicture(view: MapView, app: App): Promise<void> {
  const picture = await view.screenshot()
  if (picture) download(`map-${new Date().toISOString().slice(0, 19).replace(/:/g, '')}.png`, picture)
  else app.toasts.show('warn', 'The browser could not make the picture.')
}

function layerPanel(view: MapView): HTMLElement {
  const list = el('div', { class: 'layer-list' })
  const fill = (): void => list.replaceChildren(...view.groups.map((group) => layerRow(view, group)))
  view.ready(fill)
  setTimeout(fill, 1500) // tile maps come a moment later
  return el('div', { class: 'map-panel card', hidden: true, role: 'group', 'aria-label': 'Layers' },
    el('h2', {}, 'Layers'), list, viewButtons(view, fill))
}

function layerRow(view: MapView, group: LayerGroup): HTMLElement {
  const show = el('input', { type: 'checkbox', checked: group.visible, onchange: () => {
    group.visible = show.checked
    view.applyGroup(group)
  } })
  const opacity = el('input', { type: 'range', min: 0, max: 1, step: 0.05, value: group.opacity, 'aria-label': `Opacity of ${group.title}`,
    oninput: () => {
      group.opacity = Number(opacity.value)
      view.applyGroup(group)
    } })
  if (group.id === 'robot') opacity.style.visibility = 'hidden'
  return el('div', { class: 'layer-row' }, el('label', { class: 'check' }, show, el('span', {}, group.title)), opacity)
}

function viewButtons(view: MapView, refresh: () => void): HTMLElement {
  const { app } = view
  const save = async (): Promise<void> => {
    const name = await app.dialogs.prompt('Save this view', 'Name of the view')
    if (!name) return
    if (await app.attempt(api.saveView(name, view.current()))) app.toasts.show('info', `View “${name}” saved.`)
  }
  const load = async (): Promise<void> => {
    const names = await app.attempt(api.views())
    if (!names) return
    const body = names.length ? 'Views keep the place, the zoom and the layers.' : 'No view has been saved yet.'
    const name = await app.dialogs.ask('Open a view', [body], names.map((value) => ({ label: value, value })))
    const saved = name && (await app.attempt(api.loadView(name)))
    if (!saved) return
    view.show(saved as SavedView)
    refresh()
  }
  return el('div', { class: 'button-row' },
    el('button', { type: 'button', class: 'button', onclick: () => void save() }, icon('save', 20), 'Save view'),
    el('button', { type: 'button', class: 'button', onclick: () => void load() }, 'Open view'))
}
