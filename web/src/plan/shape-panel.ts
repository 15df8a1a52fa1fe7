/** The chosen shape in numbers. */

import { el } from '../dom.ts'
import { area, metres } from '../format.ts'
import { areaM2, lengthM } from '../geo.ts'
import { icon } from '../icons.ts'
import type { Kind, PlanDocument, Shape } from './document.ts'
import { SHAPE_OF } from './document.ts'
import { say } from '../say.ts'

const KIND_NAMES: Record<Kind, string> = {
  boundary: say('boundary'),
  obstacle: say('obstacle'),
  row: say('row'),
  crop: say('cropKeptOff'),
  ab_line: say('aBLine'),
  waypoint: say('goal'),
}

type Step = (work: () => void) => void

export function shapePanel(shape: Shape, document: PlanDocument, step: Step): (Node | false)[] {
  const type = SHAPE_OF[shape.kind]
  const size = type === 'polygon' ? area(areaM2(shape.points)) : type === 'line' ? metres(lengthM(shape.points)) : ''
  const remove = el(
    'button',
    { type: 'button', class: 'button danger', onclick: () => step(() => document.remove(shape.id)) },
    icon('trash', 20),
    say('delete'),
  )
  const order =
    shape.kind === 'waypoint'
      ? ([-1, 1] as const).map((by) =>
          el(
            'button',
            { type: 'button', class: 'button', onclick: () => step(() => document.reorder(shape.id, by)) },
            by < 0 ? say('earlier') : say('later'),
          ),
        )
      : []
  return [
    el('div', { class: 'title-row' }, el('h2', {}, KIND_NAMES[shape.kind]), el('span', { class: 'muted' }, size)),
    vertexTable(shape, document, step),
    shape.kind === 'row' && repeater(shape, document, step),
    el('div', { class: 'button-row' }, ...order, remove),
  ]
}

/** A field of rows from its first one: how many more, and how far apart. */
function repeater(shape: Shape, document: PlanDocument, step: Step): HTMLElement {
  const count = el('input', { type: 'number', class: 'field-input', value: 5, min: 1, max: 500, step: 1 })
  const spacing = el('input', { type: 'number', class: 'field-input', value: 0.75, step: 0.05 })
  const add = el(
    'button',
    {
      type: 'button',
      class: 'button',
      onclick: () => step(() => document.repeat(shape.id, Number(count.value), Number(spacing.value))),
    },
    icon('plus', 20),
    say('addRows'),
  )
  return el(
    'div',
    { class: 'stack-tight' },
    el(
      'div',
      { class: 'pair-grid' },
      el('label', { class: 'field' }, el('span', {}, say('moreRows')), count),
      el('label', { class: 'field' }, el('span', {}, say('toTheLeftM')), spacing),
    ),
    el('div', { class: 'button-row' }, add),
  )
}

function vertexTable(shape: Shape, document: PlanDocument, step: Step): HTMLElement {
  const rows = shape.points.map((point, i) => {
    const inputs = point.map((value, axis) =>
      el('input', {
        type: 'number',
        step: 0.01,
        class: 'field-input',
        value: value.toFixed(3),
        'aria-label': say(axis ? 'pointNorth' : 'pointEast', { number: i + 1 }),
        onchange: () =>
          step(() => document.moveVertex(shape.id, i, [Number(inputs[0].value), Number(inputs[1].value)])),
      }),
    )
    return el('tr', {}, el('td', { class: 'muted' }, String(i + 1)), ...inputs.map((input) => el('td', {}, input)))
  })
  return el(
    'div',
    { class: 'vertex-table', tabindex: 0, role: 'region', 'aria-label': say('points') },
    el(
      'table',
      {},
      el('thead', {}, el('tr', {}, el('th', {}, '#'), el('th', {}, say('eastM')), el('th', {}, say('northM')))),
      el('tbody', {}, ...rows),
    ),
  )
}
