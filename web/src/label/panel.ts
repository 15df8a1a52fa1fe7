/** Bar, tools and list around the picture. */

import { el, replace, setAttr, setText } from '../dom.ts'
import { icon } from '../icons.ts'
import type { LabelCanvas } from './canvas.ts'
import { CROP, KINDS, WEED } from './painting.ts'
import type { PictureState } from './server.ts'
import { countWaiting, type Session, type Tool } from './session.ts'
import { decimals, say } from '../say.ts'

const TOOLS: [Tool, string, string, string][] = [
  ['plant', say('plant'), 'P', say('plantToolAbout')],
  ['rename', say('rename'), 'R', say('renameToolAbout')],
  ['brush', say('brush'), 'B', say('brushToolAbout')],
  ['fill', say('superpixels'), 'F', say('fillToolAbout')],
  ['move', say('move'), 'V', say('moveToolAbout')],
]
const STATE_NAMES = { new: say('notLabelled'), draft: say('begun'), done: say('labelled') }
const RADII = { least: 1, most: 80 }

type Press = (event: Event) => void

function button(name: string, key: string, press: Press, more: Record<string, string> = {}): HTMLButtonElement {
  const shown = key ? el('kbd', {}, key) : null
  const title = key ? say('keyIs', { key }) : null
  return el('button', { class: 'button', type: 'button', onclick: press, title, ...more }, name, shown)
}

function choice(name: string, key: string, swatch: HTMLElement | null, press: Press): HTMLButtonElement {
  return el(
    'button',
    { class: 'choice', type: 'button', onclick: press },
    swatch,
    el('span', {}, name),
    el('kbd', {}, key),
  )
}

export function makeBar(session: Session): HTMLElement {
  const name = el('strong', { class: 'picture-name' })
  const state = el('span', { class: 'state' })
  const count = el('span', { class: 'count muted' })
  const progress = el('progress', { max: 1, value: 0, 'aria-label': say('picturesLabelled') })
  const saved = el('span', { class: 'saved muted', role: 'status' })
  const draw = (): void => {
    const done = session.pictures.filter((one) => one.state === 'done').length
    setText(name, session.current?.name ?? '')
    setText(state, session.current ? STATE_NAMES[session.current.state] : '')
    setAttr(state, 'data-state', session.current?.state ?? null)
    setText(count, say('labelledOf', { done, all: session.pictures.length }))
    progress.max = Math.max(1, session.pictures.length)
    progress.value = done
    setText(saved, session.isUnsaved ? say('notSavedYet') : session.isBusy ? say('opening') : say('saved'))
  }
  session.on('list', draw)
  session.on('change', draw)
  return el(
    'header',
    { class: 'label-bar' },
    el('h1', {}, 'AGRIBOT', el('span', { class: 'muted' }, ' label')),
    el('div', { class: 'bar-picture' }, name, state),
    saved,
    el('div', { class: 'bar-progress' }, count, progress),
  )
}

/** Says over the picture which areas are being computed, and how many strokes wait for them. */
export function makeComputing(session: Session): HTMLElement {
  const node = el('p', { class: 'computing', role: 'status', hidden: true })
  session.on('change', () => {
    const computing = session.computing && say('computing', { areas: session.computing })
    const waiting = session.waitingCount ? countWaiting(session.waitingCount) : null
    setText(node, [computing, waiting].filter(Boolean).join(' '))
    node.hidden = !computing && !waiting
  })
  return node
}

export function setRadius(session: Session, radius: number): void {
  session.radius = Math.min(RADII.most, Math.max(RADII.least, radius))
  session.emit('change', undefined)
}

function makeChoices(session: Session): HTMLElement {
  const kinds = KINDS.map((kind) => {
    const swatch = el('span', { class: 'swatch', style: `background: rgb(${kind.rgb.join(' ')})` })
    return choice(kind.name, kind.key, swatch, () => {
      session.kind = kind.id
      session.emit('change', undefined)
    })
  })
  const tools = TOOLS.map(([tool, name, key, title]) => {
    const node = choice(name, key, null, () => void session.setTool(tool))
    node.title = title
    return node
  })
  session.on('change', () => {
    for (const [i, kind] of KINDS.entries()) kinds[i]?.setAttribute('aria-pressed', String(session.kind === kind.id))
    for (const [i, [tool]] of TOOLS.entries()) tools[i]?.setAttribute('aria-pressed', String(session.tool === tool))
  })
  return el(
    'div',
    { class: 'choices' },
    el('div', { class: 'choice-row kinds', role: 'group', 'aria-label': say('kindOfPlant') }, ...kinds),
    el('div', { class: 'choice-row tools', role: 'group', 'aria-label': say('tool') }, ...tools),
  )
}

function makeSliders(session: Session, canvas: LabelCanvas): HTMLElement {
  const size = el('input', { type: 'range', min: RADII.least, max: RADII.most, 'aria-label': say('brushSize') })
  const text = el('output', {})
  size.addEventListener('input', () => setRadius(session, Number(size.value)))
  const opacity = el('input', { type: 'range', min: 0, max: 100, value: 90, 'aria-label': say('strengthOfTheColours') })
  opacity.addEventListener('input', () => canvas.setOpacity(Number(opacity.value) / 100))
  canvas.setOpacity(0.9)
  session.on('change', () => {
    size.value = String(session.radius)
    setText(text, `${2 * session.radius} px`)
  })
  return el(
    'div',
    { class: 'sliders' },
    el('label', { class: 'slider' }, el('span', {}, `${say('size')} `, text), size),
    el('label', { class: 'slider' }, el('span', {}, 'Colours'), opacity),
  )
}

/** What gives all plants of one class in this picture the other one. */
function makeRenames(session: Session): HTMLElement {
  const renames = [
    button(say('allWeedIsCrop'), '', () => void session.renameAll(WEED, CROP)),
    button(say('allCropIsWeed'), '', () => void session.renameAll(CROP, WEED)),
  ]
  session.on('change', () => {
    for (const node of renames) node.disabled = session.isBusy
  })
  return el('div', { class: 'actions' }, ...renames)
}

function makeActions(session: Session, canvas: LabelCanvas): HTMLElement {
  const undo = button(say('undo'), 'Z', () => session.undo())
  const redo = button(say('redo'), 'Y', () => session.redo())
  session.on('change', () => {
    undo.disabled = !session.canUndo
    redo.disabled = !session.canRedo
  })
  const zoomOut = el('button', { class: 'button', type: 'button', 'aria-label': say('zoomOut') }, icon('minus', 20))
  const zoomIn = el('button', { class: 'button', type: 'button', 'aria-label': say('zoomIn') }, icon('plus', 20))
  zoomOut.addEventListener('click', () => canvas.zoom(1 / 1.5))
  zoomIn.addEventListener('click', () => canvas.zoom(1.5))
  const fit = button(say('fit'), '0', () => canvas.fit())
  return el('div', { class: 'actions' }, undo, redo, zoomOut, zoomIn, fit)
}

function makeSteps(session: Session): HTMLElement {
  const before = button('‹', '', () => void session.step(-1), { 'aria-label': say('previousPicture') })
  const after = button('›', '', () => void session.step(1), { 'aria-label': say('nextPicture') })
  const done = button(say('doneNext'), '⏎', () => void session.finish(), { class: 'button primary finish' })
  session.on('change', () => {
    before.disabled = session.isBusy || session.place <= 0
    after.disabled = session.isBusy || session.place >= session.pictures.length - 1
    done.disabled = session.isBusy
  })
  return el('div', { class: 'steps' }, before, done, after)
}

function makeList(session: Session): HTMLElement {
  const list = el('ol', { class: 'picture-list' })
  const about = el('span', { class: 'muted' })
  const row = (picture: PictureState): HTMLElement => {
    const unsure = picture.uncertainty === null ? '…' : `${decimals(100 * picture.uncertainty, 1)} %`
    const press = (): void => void session.open(picture)
    return el(
      'li',
      {},
      el(
        'button',
        { type: 'button', onclick: press, 'aria-current': picture.number === session.current?.number && 'true' },
        el('span', { class: 'dot', 'data-state': picture.state, title: STATE_NAMES[picture.state] }),
        el('span', { class: 'name' }, picture.name),
        el('span', { class: 'muted' }, unsure),
      ),
    )
  }
  const draw = (): void => {
    setText(about, session.about)
    const scroll = list.scrollTop
    replace(list, ...session.pictures.map(row))
    list.scrollTop = scroll
  }
  session.on('list', draw)
  session.on('change', draw)
  return el(
    'section',
    { class: 'pictures', 'aria-label': say('pictures') },
    el('div', { class: 'pictures-head' }, el('h2', {}, say('leastSureFirst')), about),
    list,
  )
}

export function makePanel(session: Session, canvas: LabelCanvas): HTMLElement {
  return el(
    'aside',
    { class: 'label-panel' },
    makeChoices(session),
    makeRenames(session),
    makeSliders(session, canvas),
    makeActions(session, canvas),
    makeSteps(session),
    makeList(session),
  )
}
