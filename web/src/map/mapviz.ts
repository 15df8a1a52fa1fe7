/** Configurations of mapviz in and out: the displays of the map with their topics and looks, and what it stays on. */

import { api } from '../api.ts'
import { typeOf } from '../displays/types.ts'
import { Display } from '../displays/display.ts'
import { readTopicId, topicId } from '../displays/topics.ts'
import { download, el } from '../dom.ts'
import type { ImportedView } from '../wire.ts'
import type { MapView } from './view.ts'
import { say } from '../say.ts'

export function mapvizButtons(view: MapView, refresh: () => void): HTMLElement[] {
  const { app } = view
  const file = el('input', {
    type: 'file',
    accept: '.mvc,.yaml,.yml',
    class: 'visually-hidden',
    'aria-label': say('mapvizConfiguration'),
    tabindex: -1,
    onchange: () => void read(),
  })
  const read = async (): Promise<void> => {
    const chosen = file.files?.[0]
    const found = chosen && (await app.attempt(api.importView(chosen)))
    file.value = ''
    if (!found) return
    await view.displays.findTopics()
    const leftOut = addAll(view, found)
    view.tracking.take(found.view.target, found.view.turn)
    refresh()
    await app.dialogs.ask(say('fromMapviz'), report(found.displays.length, leftOut), [
      { label: say('done'), value: true, kind: 'primary' },
    ])
  }
  const write = async (): Promise<void> => {
    const text = await app.attempt(api.exportView(shown(view), view.tracking.told()))
    if (text) download('view.mvc', text)
  }
  return [
    el('button', { type: 'button', class: 'button', onclick: () => file.click() }, say('fromMapviz')),
    el('button', { type: 'button', class: 'button', onclick: () => void write() }, say('toMapviz')),
    file,
  ]
}

/** What could not be shown, with the reason. The topmost comes last, and so lies above the others. */
function addAll(view: MapView, found: ImportedView): ImportedView['left_out'] {
  const leftOut = [...found.left_out]
  for (const wanted of found.displays) {
    const why = add(view, wanted)
    if (why) leftOut.push({ name: wanted.title, why })
  }
  view.remember()
  return leftOut
}

/** Why one of them is not shown, or not as it was; empty where all is well. */
function add(
  view: MapView,
  { type, title, source, options, visible, opacity }: ImportedView['displays'][number],
): string {
  const kind = typeOf(type)
  const sources = kind ? view.displays.sources(kind) : []
  const named = sources.find(({ id, title: name }) => id === source || name === source)
  // The robot's own data are the same, whatever the topic was called; a map has to be the one that is named.
  const chosen = named ?? (kind?.kind === 'tiles' ? undefined : sources[0])
  if (kind?.kind === 'tiles' && !chosen) {
    return say('mapIsMissing', { name: source || title, command: 'agribot map import' })
  }
  const isTopic = source.startsWith('/') && kind?.kind !== 'tiles'
  const display = view.displays.make(type, title, chosen?.id ?? (isTopic ? topicId('ros1', source) : source), options)
  if (!display) return say('itCouldNotBeAdded')
  Object.assign(display, { visible, opacity })
  view.applyGroup(display)
  if (named || !source) return ''
  return chosen ? say('showsInPlace', { title: chosen.title, source }) : say('nothingGives', { source })
}

function shown(view: MapView): object[] {
  return view.groups
    .filter((group): group is Display => group instanceof Display)
    .reverse()
    .map((display) => {
      const saved = display.saved()
      const source = readTopicId(saved.source)?.name.replace(/^frame:/, '') ?? saved.source
      return { ...saved, source, visible: display.visible, opacity: display.opacity }
    })
}

function report(count: number, leftOut: ImportedView['left_out']): (Node | string)[] {
  const lines = leftOut.map(({ name, why }) => el('li', {}, el('strong', {}, name), `: ${why}`))
  return [
    el('p', {}, say('displaysRead', { count })),
    ...(lines.length ? [el('ul', { class: 'left-out' }, ...lines)] : []),
  ]
}
