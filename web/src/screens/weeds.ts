/** The weed map: filter, density, one weed's details, files for other programs. */

import type { FilterSpecification, MapMouseEvent } from 'maplibre-gl'
import { api, message } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el, replace, setText } from '../dom.ts'
import { area, duration, fixed, metres, NONE } from '../format.ts'
import { icon } from '../icons.ts'
import { mapControls } from '../map/controls.ts'
import { openMap } from '../map/shared.ts'
import type { MapView } from '../map/view.ts'
import type { WeedUpdate } from '../store.ts'
import type { Weed } from '../wire.ts'
import { passes, sinceS } from '../weed-filter.ts'
import type { WeedFilter } from '../weed-filter.ts'
import { many, named, say } from '../say.ts'

const COUNT_EVERY_MS = 1000
const PICK_PX = 8

export const weeds: Screen = {
  id: 'weeds',
  title: say('screenWeeds'),
  icon: 'weeds',
  async mount(host, app) {
    const filter: WeedFilter = { weeds: true, crop: true, treated: true, open: true, confidence: 0, withinS: null }
    const mapHost = el('div', { class: 'map-host card' })
    const count = el('p', { class: 'count' })
    const details = new Details(app)
    let view: MapView | null = null
    const apply = (): void => {
      showCount(count, app, filter)
      view?.ready(() => view?.map.setFilter('weeds', mapFilter(filter, nowS(app))))
    }
    host.append(
      mapHost,
      el(
        'div',
        { class: 'side' },
        filterCard(filter, count, apply),
        el('div', { class: 'card' }, stepButtons(app, filter, details), details.node),
        exportCard(),
      ),
    )
    const timer = setInterval(() => {
      if (filter.withinS === null) showCount(count, app, filter)
      else apply() // what was seen of late is something else by now
    }, COUNT_EVERY_MS)
    view = await openMap(mapHost, app)
    apply()
    const done = (): void => {
      clearInterval(timer)
      details.done()
    }
    if (!view) return done
    const controls = mapControls(view, app, ['measure', 'coordinates'])
    mapHost.append(controls.node)
    const stopPicking = pick(view, app, details)
    return () => {
      done()
      stopPicking()
      controls.done()
      view?.ready(() => view?.map.setFilter('weeds', null))
    }
  },
}

function nowS(app: App): number {
  return app.store.state?.t_s ?? 0
}

function showCount(node: HTMLElement, app: App, filter: WeedFilter): void {
  let shown = 0
  for (const weed of app.store.weeds.values()) if (passes(weed, filter, nowS(app))) shown++
  setText(node, say('plantsShown', { shown: many(shown), all: many(app.store.weeds.size) }))
}

function mapFilter(filter: WeedFilter, nowS: number): FilterSpecification {
  const since = sinceS(filter, nowS)
  const rules: FilterSpecification[] = [['>=', ['get', 'confidence'], filter.confidence]]
  if (!filter.weeds) rules.push(['!=', ['get', 'plant'], 0])
  if (!filter.crop) rules.push(['!=', ['get', 'plant'], 1])
  if (!filter.treated) rules.push(['!', ['get', 'treated']])
  if (!filter.open) rules.push(['get', 'treated'] as unknown as FilterSpecification)
  if (since !== null) rules.push(['>=', ['get', 'last_seen_s'], since])
  return ['all', ...rules] as FilterSpecification
}

function filterCard(filter: WeedFilter, count: HTMLElement, apply: () => void): HTMLElement {
  const toggle = (name: 'weeds' | 'crop' | 'treated' | 'open', label: string, swatch = ''): HTMLElement => {
    const box = el('input', {
      type: 'checkbox',
      checked: true,
      onchange: () => {
        filter[name] = box.checked
        apply()
      },
    })
    return el('label', { class: 'check' }, box, swatch !== '' && el('span', { class: `swatch ${swatch}` }), label)
  }
  const value = el('span', { class: 'value' }, '0 %')
  const confidence = el('input', {
    type: 'range',
    min: 0,
    max: 1,
    step: 0.05,
    value: 0,
    oninput: () => {
      filter.confidence = Number(confidence.value)
      setText(value, `${Math.round(filter.confidence * 100)} %`)
      apply()
    },
  })
  const time = el(
    'select',
    {
      onchange: () => {
        filter.withinS = Number(time.value) || null
        apply()
      },
    },
    ...[
      ['', say('anyTime')],
      ['60', say('inTheLastMinute')],
      ['600', say('inLast10Minutes')],
    ].map(([v, text]) => el('option', { value: v }, text)),
  )
  return el(
    'div',
    { class: 'card stack' },
    el('h2', {}, say('show')),
    count,
    el(
      'div',
      { class: 'checks pair' },
      toggle('weeds', say('screenWeeds'), 'map-weed'),
      toggle('crop', say('crop'), 'map-crop'),
      toggle('treated', say('treated')),
      toggle('open', say('notTreated')),
    ),
    el('label', { class: 'field' }, el('span', { class: 'label-row' }, say('confidenceAtLeast'), value), confidence),
    el('label', { class: 'field' }, el('span', {}, say('seen')), time),
  )
}

function exportCard(): HTMLElement {
  return el(
    'div',
    { class: 'card stack' },
    el('h2', {}, say('export')),
    el(
      'div',
      { class: 'button-row' },
      el(
        'a',
        { class: 'button', href: '/api/v1/weeds.geojson', download: 'weeds.geojson' },
        icon('download', 20),
        'GeoJSON',
      ),
      el('a', { class: 'button', href: '/api/v1/weeds.csv', download: 'weeds.csv' }, icon('download', 20), 'CSV'),
    ),
  )
}

function pick(view: MapView, app: App, details: Details): () => void {
  const click = (event: MapMouseEvent): void => {
    if (view.tools.tool !== 'pan') return
    const { x, y } = event.point
    const found = view.map.queryRenderedFeatures(
      [
        [x - PICK_PX, y - PICK_PX],
        [x + PICK_PX, y + PICK_PX],
      ],
      { layers: ['weeds'] },
    )
    const id: unknown = found[0]?.properties.id
    const weed = typeof id === 'number' ? app.store.weeds.get(id) : undefined
    if (weed) details.show(weed)
  }
  view.map.on('click', click)
  return () => view.map.off('click', click)
}

/** From plant to plant in the order of the map, beginning with the newest: what a map does for those who can tap it. */
function stepButtons(app: App, filter: WeedFilter, details: Details): HTMLElement {
  const step = (by: 1 | -1): void => {
    const ids = [...app.store.weeds.values()]
      .filter((weed) => passes(weed, filter, nowS(app)))
      .map(({ id }) => id)
      .sort((a, b) => a - b)
    const from = details.id ?? Infinity
    const next =
      by > 0 ? (ids.find((id) => id > from) ?? ids[0]) : (ids.filter((id) => id < from).pop() ?? ids[ids.length - 1])
    const weed = next === undefined ? undefined : app.store.weeds.get(next)
    if (weed) details.show(weed)
  }
  return el(
    'div',
    { class: 'button-row steps' },
    el('button', { type: 'button', class: 'button', onclick: () => step(-1) }, say('plantBefore')),
    el('button', { type: 'button', class: 'button', onclick: () => step(1) }, say('plantAfter')),
  )
}

/** Comes in when the robot has answered; without one the robot's reason stands there. */
function weedPicture(id: number): HTMLElement {
  const figure = el('figure', { class: 'weed-picture' })
  api
    .weedPicture(id)
    .then(({ picture, takenS }) => {
      const url = URL.createObjectURL(picture)
      replace(
        figure,
        el('img', { src: url, alt: say('weedInCamera', { id }), onload: () => URL.revokeObjectURL(url) }),
        el('figcaption', { class: 'muted' }, say('pictureFrom', { time: duration(takenS) })),
      )
    })
    .catch((error: unknown) => replace(figure, el('figcaption', { class: 'muted' }, message(error))))
  return figure
}

/** One plant of the map, as it is now. */
class Details {
  readonly node = el('div', { class: 'details' })
  id: number | null = null
  private readonly facts = el('div')
  readonly done: () => void

  constructor(private readonly app: App) {
    this.begin()
    const undo = [
      app.store.on('weeds', (changes) => this.update(changes)),
      app.store.on('restart', () => this.begin()), // its number is another plant there
    ]
    this.done = () => undo.forEach((each) => each())
  }

  show(weed: Weed): void {
    this.id = weed.id
    const isWeed = weed.plant === 0
    replace(this.node, el('h2', {}, title(weed)), isWeed && weedPicture(weed.id), this.facts)
    this.tell(weed)
  }

  private update({ set, all }: WeedUpdate): void {
    if (this.id === null) return
    const weed = this.app.store.weeds.get(this.id)
    if (!weed) {
      this.explain(say('plantIsGone', { id: this.id }))
      this.id = null
    } else if (all || set.some(({ id }) => id === weed.id)) {
      setText(this.node.querySelector('h2') as HTMLElement, title(weed))
      this.tell(weed)
    }
  }

  private begin(): void {
    this.id = null
    this.explain(say('tapAPlantOnTheMap'))
  }

  private explain(words: string): void {
    replace(this.node, el('h2', {}, say('details')), el('p', { class: 'muted' }, words))
  }

  private tell(weed: Weed): void {
    const { x_map_m: x, y_map_m: y } = weed
    const [lon, lat] = this.app.projection.toLonLat(x, y)
    const rows: [string, string][] = [
      [say('confidence'), fixed(weed.confidence * 100, 0, '%')],
      [say('size'), area(weed.area_m2)],
      [say('position'), metres(weed.std_m)],
      [say('sightings'), String(weed.sightings)],
      [say('firstSeen'), duration(weed.first_seen_s)],
      [say('lastSeen'), duration(weed.last_seen_s)],
      [say('treated'), weed.treated_s === null ? NONE : duration(weed.treated_s)],
      ...(weed.left ? [[say('leftBecause'), named(weed.left)] as [string, string]] : []),
      [say('eastNorth'), `${fixed(x, 2)}, ${fixed(y, 2)} m`],
    ]
    const lines = rows.map(([name, text]) => el('div', {}, el('dt', {}, name), el('dd', {}, text)))
    replace(
      this.facts,
      el('dl', { class: 'facts plain' }, ...lines),
      el('p', { class: 'mono select-all' }, `${lat.toFixed(8)}, ${lon.toFixed(8)}`),
    )
  }
}

function title({ plant, id }: Weed): string {
  return say(plant === 0 ? 'weedNumber' : 'cropNumber', { id })
}
