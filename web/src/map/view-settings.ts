/** What the map stays on, how large its pictures are, and where on earth it begins. */

import { el, setText } from '../dom.ts'
import { icon } from '../icons.ts'
import { CAPTURE_SIZES } from './capture.ts'
import type { CaptureSize } from './capture.ts'
import { TARGETS } from './tracking.ts'
import type { Target } from './tracking.ts'
import type { MapView } from './view.ts'
import { decimals, say } from '../say.ts'

export interface ViewSettings {
  node: HTMLElement
  refresh: () => void
  done: () => void
}

export function viewSettings(view: MapView): ViewSettings {
  const { app, tracking, capture } = view
  const target = choice(TARGETS, (value) => tracking.choose(value as Target))
  const size = choice(CAPTURE_SIZES, (value) => {
    capture.size = value as CaptureSize
    view.remember()
  })
  const turn = el(
    'button',
    { type: 'button', class: 'button', onclick: () => tracking.turn() },
    icon('redo', 20),
    say('turnBy90'),
  )
  const origin = el('p', { class: 'muted small select-all' })
  const done = app.onField(() => {
    const { datum, datum_source: source, declination_deg: declination = 0 } = app.field ?? {}
    if (datum)
      setText(
        origin,
        say('originText', {
          place: `${datum.lat_deg.toFixed(7)}, ${datum.lon_deg.toFixed(7)}${source ? ` · ${source}` : ''}`,
          declination: decimals(declination, 1),
        }),
      )
  })
  const refresh = (): void => {
    target.value = tracking.target
    size.value = capture.size
  }
  refresh()
  const node = el(
    'div',
    { class: 'stack-tight wide' },
    el('label', { class: 'field' }, el('span', {}, say('targetFrame')), target),
    el('label', { class: 'field' }, el('span', {}, say('picturesAndVideos')), size),
    turn,
    origin,
  )
  return { node, refresh, done }
}

function choice(known: Record<string, string>, choose: (value: string) => void): HTMLSelectElement {
  const select = el(
    'select',
    { onchange: () => choose(select.value) },
    ...Object.entries(known).map(([value, words]) => el('option', { value }, words)),
  )
  return select
}
