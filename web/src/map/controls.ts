/** The buttons on the map: zoom, follow, overview, layers, tools, picture, saved views. */

import type { MapMouseEvent } from 'maplibre-gl'
import { api } from '../api.ts'
import type { App } from '../app.ts'
import { Display } from '../displays/display.ts'
import type { LayerGroup, ToolId } from '../displays/host.ts'
import { download, el, setText } from '../dom.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import { addDisplay, editGroup } from './display-dialog.ts'
import { mapvizButtons } from './mapviz.ts'
import { TOOLS } from './tools.ts'
import type { SavedView, MapView } from './view.ts'
import { viewSettings } from './view-settings.ts'
import type { ViewSettings } from './view-settings.ts'
import { decimals, say } from '../say.ts'

function mapButton(name: IconName, title: string, action: () => void): HTMLButtonElement {
  return el('button', { type: 'button', class: 'map-button', title, 'aria-label': title, onclick: action }, icon(name))
}

/** Which tools a screen offers; all by default. */
export function mapControls(
  view: MapView,
  app: App,
  tools: ToolId[] = TOOLS.map((t) => t.id),
): { node: HTMLElement; done: () => void } {
  const follow = mapButton('follow', say('followTheRobot'), () => view.tracking.toggle())
  const film = filmButton(view, app)
  const cursor = cursorLine(view)
  const layersButton = mapButton('layers', say('layersAndViews'), () => {
    layers.hidden = !layers.hidden
    layersButton.setAttribute('aria-expanded', String(!layers.hidden))
  })
  layersButton.setAttribute('aria-expanded', 'false')
  const hint = hintLine(view)
  const bar = toolBar(view, tools, hint)
  const settings = viewSettings(view)
  const layers = layerPanel(view, bar.choose, settings)
  const conditions = conditionLines(view)
  view.onConditions = () => {
    conditions.refresh()
    layers.querySelectorAll<HTMLElement>('.layer-row').forEach((row, i) => tellRow(row, view.groups[i]))
  }
  view.tracking.onTarget = () => {
    follow.setAttribute('aria-pressed', String(view.tracking.target !== 'map'))
    settings.refresh()
  }
  view.tracking.onTarget()
  const node = el(
    'div',
    { class: 'map-controls' },
    el(
      'div',
      { class: 'map-stack' },
      mapButton('plus', say('zoomIn'), () => view.zoomBy(1)),
      mapButton('minus', say('zoomOut'), () => view.zoomBy(-1)),
      follow,
      mapButton('fit', say('wholeField'), () => view.overview()),
      layersButton,
      mapButton('image', say('saveMapPicture'), () => void savePicture(view, app)),
      film,
    ),
    bar.node,
    conditions.node,
    cursor.node,
    hint.node,
    view.tools.proposals.card.node,
    layers,
  )
  const done = (): void => {
    cursor.done()
    settings.done()
    view.tools.choose('pan')
  }
  return { node, done }
}

const MOST_LINES = 4

/** What is wrong with displays that are shown, a line each. */
function conditionLines(view: MapView): { node: HTMLElement; refresh: () => void } {
  const node = el('ul', { class: 'map-conditions', role: 'status', 'aria-label': say('displays') })
  const refresh = (): void => {
    const lines = view.displays.all
      .filter(({ visible, condition }) => visible && condition.note)
      .map(({ title, condition }) => ({ text: `${title}: ${condition.note}`, isStale: condition.isStale }))
    const more = lines.length - MOST_LINES
    node.replaceChildren(
      ...lines.slice(0, MOST_LINES).map(({ text, isStale }) => el('li', { class: isStale ? 'stale' : '' }, text)),
      ...(more > 0 ? [el('li', {}, say('displaysMore', { count: more }))] : []),
    )
  }
  return { node, refresh }
}

function tellRow(row: HTMLElement, group: LayerGroup | undefined): void {
  const note = row.querySelector<HTMLElement>('.layer-note')
  if (!note || !group) return
  setText(note, noteOf(group))
  note.classList.toggle('muted', !(group instanceof Display && group.condition.note))
}

function noteOf(group: LayerGroup): string {
  return group instanceof Display ? group.condition.note || group.condition.leftOut : ''
}

/** Where the mouse is, in the map and on the earth; a finger has the tool for that. */
function cursorLine({ map, app }: MapView): { node: HTMLElement; done: () => void } {
  const node = el('div', { class: 'map-cursor', 'aria-hidden': 'true' })
  const move = ({ lngLat: { lng, lat } }: MapMouseEvent): void => {
    const [x, y] = app.projection.toMap(lng, lat)
    const place = `${lat.toFixed(7)}, ${lng.toFixed(7)}`
    setText(node, say('cursorText', { east: decimals(x, 2), north: decimals(y, 2), place }))
  }
  const leave = (): void => setText(node, '')
  map.on('mousemove', move)
  map.on('mouseout', leave)
  return { node, done: () => map.off('mousemove', move).off('mouseout', leave) }
}

interface Hint {
  node: HTMLElement
  show: (text: string) => void
}

/** What the tool says, and a button that copies what it has read. */
function hintLine(view: MapView): Hint {
  const text = el('output', { class: 'select-all' })
  const copy = el(
    'button',
    {
      type: 'button',
      class: 'icon-button quiet',
      'aria-label': say('copyThePosition'),
      onclick: () => void copyText(view),
    },
    icon('copy', 20),
  )
  const node = el('div', { class: 'map-hint', hidden: true }, text, copy)
  const show = (words: string): void => {
    setText(text, words)
    node.hidden = !words
    copy.hidden = !view.tools.copied
  }
  return { node, show }
}

async function copyText({ tools, app }: MapView): Promise<void> {
  try {
    await navigator.clipboard.writeText(tools.copied) // only where the page came by https or from this machine
  } catch {
    const area = el('textarea', { class: 'visually-hidden' }, tools.copied)
    document.body.append(area)
    area.select()
    document.execCommand('copy')
    area.remove()
  }
  app.toasts.show('info', say('copied', { text: tools.copied }))
}

function toolBar(view: MapView, wanted: ToolId[], hint: Hint): { node: HTMLElement; choose: (id: ToolId) => void } {
  const buttons = TOOLS.filter((tool) => wanted.includes(tool.id)).map((tool) => {
    const button = mapButton(tool.icon, tool.title, () => choose(view.tools.tool === tool.id ? 'pan' : tool.id))
    button.dataset.tool = tool.id
    return button
  })
  const open = mapButton('tools', say('mapTools'), () => {
    setOpen(node.dataset.open !== 'true')
  })
  open.classList.add('tools-toggle')
  const node = el('div', { class: 'map-tools', role: 'toolbar', 'aria-label': say('mapTools') }, open, ...buttons)
  const setOpen = (isOpen: boolean): void => {
    node.dataset.open = String(isOpen)
    open.setAttribute('aria-expanded', String(isOpen))
  }
  const choose = (id: ToolId): void => {
    view.tools.choose(id)
    const chosen = TOOLS.find((tool) => tool.id === id)
    for (const button of buttons) button.setAttribute('aria-pressed', String(button.dataset.tool === id))
    open.replaceChildren(icon(chosen?.icon ?? 'tools'))
    open.setAttribute('aria-pressed', String(chosen !== undefined))
    setOpen(false)
  }
  view.tools.onText = hint.show
  view.tools.proposals.onEnd = () => choose('pan')
  choose('pan')
  return { node, choose }
}

function stamp(): string {
  return new Date().toISOString().slice(0, 19).replace(/:/g, '')
}

function filmButton(view: MapView, app: App): HTMLElement {
  const button = mapButton('video', say('recordMapVideo'), () => void toggle())
  const show = (): void => button.setAttribute('aria-pressed', String(view.capture.isRecording))
  const toggle = async (): Promise<void> => {
    if (!view.capture.isRecording) {
      if (view.capture.start()) app.toasts.show('info', say('filmingMap'))
      else app.toasts.show('warn', say('noVideo'))
    } else {
      const film = await view.capture.stop()
      if (film) download(`map-${stamp()}.${film.suffix}`, film.film)
    }
    show()
  }
  show()
  return button
}

async function savePicture(view: MapView, app: App): Promise<void> {
  const picture = await view.capture.picture()
  if (picture) download(`map-${stamp()}.png`, picture)
  else app.toasts.show('warn', say('noMapPicture'))
}

function layerPanel(view: MapView, useTool: (id: ToolId) => void, settings: ViewSettings): HTMLElement {
  const list = el('div', { class: 'layer-list' })
  const fill = (): void => list.replaceChildren(...view.groups.map((group) => layerRow(view, group)))
  view.ready(fill)
  view.onGroups = fill
  const add = el(
    'button',
    { type: 'button', class: 'button', onclick: () => void addDisplay(view, useTool) },
    icon('plus', 20),
    say('addDisplay'),
  )
  return el(
    'div',
    { class: 'map-panel card', hidden: true, role: 'group', 'aria-label': say('layers') },
    el('div', { class: 'title-row' }, el('h2', {}, say('layers')), add),
    list,
    settings.node,
    viewButtons(view, fill),
  )
}

function layerRow(view: MapView, group: LayerGroup): HTMLElement {
  const show = el('input', {
    type: 'checkbox',
    checked: group.visible,
    onchange: () => {
      group.visible = show.checked
      view.applyGroup(group)
      view.onConditions()
    },
  })
  const opacity = el('input', {
    type: 'range',
    min: 0,
    max: 1,
    step: 0.05,
    value: group.opacity,
    'aria-label': say('opacityOf', { name: group.title }),
    oninput: () => {
      group.opacity = Number(opacity.value)
      view.applyGroup(group)
    },
  })
  if (group.id === 'robot') opacity.style.visibility = 'hidden'
  const edit = el(
    'button',
    {
      type: 'button',
      class: 'icon-button',
      'aria-label': say('changeThis', { name: group.title }),
      onclick: () => void editGroup(view, group),
    },
    icon('settings', 20),
  )
  const row = el(
    'div',
    { class: 'layer-row' },
    el('label', { class: 'check' }, show, el('span', {}, group.title)),
    opacity,
    edit,
    el('p', { class: 'layer-note' }),
  )
  tellRow(row, group)
  return row
}

function viewButtons(view: MapView, refresh: () => void): HTMLElement {
  const { app } = view
  const save = async (): Promise<void> => {
    const name = await app.dialogs.prompt(say('saveThisView'), say('nameOfTheView'))
    if (!name) return
    if (await app.attempt(api.saveView(name, view.current()))) app.toasts.show('info', say('viewSaved', { name }))
  }
  const load = async (): Promise<void> => {
    const names = await app.attempt(api.views())
    if (!names) return
    const body = names.length ? say('viewsAbout') : say('noViewSaved')
    const name = await app.dialogs.ask(
      say('openAView'),
      [body],
      names.map((value) => ({ label: value, value })),
    )
    const saved = name && (await app.attempt(api.loadView(name)))
    if (!saved) return
    view.show(saved as SavedView)
    refresh()
  }
  return el(
    'div',
    { class: 'pair-grid' },
    el('button', { type: 'button', class: 'button', onclick: () => void save() }, icon('save', 20), say('saveView')),
    el('button', { type: 'button', class: 'button', onclick: () => void load() }, icon('plan', 20), say('openView')),
    ...mapvizButtons(view, refresh),
  )
}
