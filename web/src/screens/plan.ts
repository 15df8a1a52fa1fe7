/** Draw a field, check the plan that follows from it, and drive it. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el, replace } from '../dom.ts'
import { area, duration, metres } from '../format.ts'
import { areaM2, lengthM } from '../geo.ts'
import { icon } from '../icons.ts'
import type { IconName } from '../icons.ts'
import { mapControls } from '../map/controls.ts'
import { openMap } from '../map/shared.ts'
import { BoundaryRecorder } from '../plan/boundary-recorder.ts'
import type { Kind, ShapeType } from '../plan/document.ts'
import { fromGeoJson, PlanDocument, SHAPE_OF, shapesOf, toGeoJson } from '../plan/document.ts'
import type { Drawing } from '../plan/drawing.ts'
import { fileCard } from '../plan/files.ts'
import { shapePanel } from '../plan/shape-panel.ts'
import { takeSeat } from '../shell/seat.ts'
import type { PlanReply, PlanWish } from '../wire.ts'
import { langOf, say } from '../say.ts'

const TOOLS: [Kind, string, IconName][] = [
  ['boundary', say('boundary'), 'polygon'],
  ['obstacle', say('obstacle'), 'cancel'],
  ['row', say('row'), 'line'],
  ['ab_line', say('aBLine'), 'measure'],
  ['waypoint', say('goals'), 'pin'],
]

const COUNTS = {
  boundary: 'countBoundary',
  obstacle: 'countObstacle',
  row: 'countRow',
  crop: 'countCrop',
  ab_line: 'countAbLine',
  waypoint: 'countGoal',
} as const satisfies Record<Kind, string>

/** What to do while a shape is drawn. */
const HINTS: Record<ShapeType, string> = {
  polygon: say('hintPolygon'),
  line: say('hintLine'),
  point: say('hintGoals'),
}

const kept = new PlanDocument() // survives going to another screen and back

export const plan: Screen = {
  id: 'plan',
  title: say('screenPlan'),
  icon: 'plan',
  async mount(host, app) {
    const mapHost = el('div', { class: 'map-host card' })
    const side = el('div', { class: 'side' })
    host.append(mapHost, side)
    const view = await openMap(mapHost, app)
    if (!view) {
      side.append(el('p', { class: 'card empty' }, say('planNeedsMap')))
      return () => undefined
    }
    const controls = mapControls(view, app, ['measure', 'coordinates'])
    mapHost.append(controls.node)
    const { Drawing } = await import('../plan/drawing.ts')
    await new Promise<void>((resolve) => view.ready(resolve))
    if (!kept.shapes.length && !kept.canUndo && app.field) kept.start(shapesOf(app.field))
    const drawing = new Drawing(view, kept)
    const editor = new Editor(app, drawing, side)
    return () => {
      editor.close()
      drawing.close()
      controls.done()
    }
  },
}

class Editor {
  private readonly shape = el('div', { class: 'card stack', hidden: true })
  private readonly summary = el('p', { class: 'muted' })
  private readonly verdict = el('div', { class: 'stack-tight', role: 'status' })
  private readonly undo: HTMLButtonElement
  private readonly redo: HTMLButtonElement
  private readonly apply: HTMLButtonElement
  private readonly tools: HTMLButtonElement[]
  private readonly width = numberInput(null, 0.2, 30, 0.01)
  private readonly passes = numberInput(2, 0, 10, 1)
  private readonly gone = el('input', { type: 'checkbox' })
  private readonly recorder: BoundaryRecorder
  private selected: string | null = null
  private version = 0 // of what is drawn and asked for: an answer counts for its own alone

  constructor(
    private readonly app: App,
    private readonly drawing: Drawing,
    side: HTMLElement,
  ) {
    this.width.value = String(app.robot?.tool_width_m ?? '')
    for (const input of [this.width, this.passes, this.gone]) input.addEventListener('input', () => this.change())
    this.undo = iconButton('undo', say('undo'), () => this.step(() => kept.undo()))
    this.redo = iconButton('redo', say('redo'), () => this.step(() => kept.redo()))
    this.apply = el(
      'button',
      { type: 'button', class: 'button primary', disabled: true, onclick: () => void this.use() },
      icon('play', 20),
      say('useThisPlan'),
    )
    this.tools = TOOLS.map(([kind, title, name]) =>
      el(
        'button',
        {
          type: 'button',
          class: 'button tool',
          'aria-pressed': 'false',
          'data-kind': kind,
          onclick: () => this.choose(kind),
        },
        icon(name, 20),
        title,
      ),
    )
    this.recorder = new BoundaryRecorder(app, (points) =>
      this.step(() => kept.change([...kept.shapes, { id: 'recorded', kind: 'boundary', points }])),
    )
    drawing.onChange = () => this.change()
    drawing.onSelect = (id) => {
      this.selected = id
      this.refresh()
    }
    side.append(
      this.drawCard(),
      this.shape,
      this.planCard(),
      fileCard(app, {
        content: () => toGeoJson(kept.shapes, app.projection),
        clear: () => this.step(() => kept.change([])),
        open: (collection) => this.step(() => kept.change(fromGeoJson(collection, app.projection))),
      }),
    )
    this.refresh()
  }

  private drawCard(): HTMLElement {
    return el(
      'div',
      { class: 'card stack' },
      el('div', { class: 'title-row' }, el('h2', {}, say('draw')), el('div', {}, this.undo, this.redo)),
      el('div', { class: 'tool-grid' }, ...this.tools, this.recorder.button),
      this.summary,
    )
  }

  private planCard(): HTMLElement {
    const check = el(
      'button',
      { type: 'button', class: 'button', onclick: () => void this.check() },
      icon('check', 20),
      say('checkPlan'),
    )
    return el(
      'div',
      { class: 'card stack' },
      el('h2', {}, say('planCard')),
      el(
        'div',
        { class: 'pair-grid' },
        el('label', { class: 'field' }, el('span', {}, say('workingWidthM')), this.width),
        el('label', { class: 'field' }, el('span', {}, say('headlandPasses')), this.passes),
      ),
      this.cropChoice(),
      el('div', { class: 'button-row' }, check, this.apply),
      this.verdict,
    )
  }

  /** Rows that stand on the map are kept off, whether they are drawn here or not. */
  private cropChoice(): HTMLElement | null {
    const rows = this.app.field?.crop_map_m.length
    if (!rows) return null
    return el('label', { class: 'check' }, this.gone, say('cropIsGone', { rows }))
  }

  private choose(kind: Kind): void {
    const pressed = this.tools.find((tool) => tool.dataset.kind === kind)?.getAttribute('aria-pressed') === 'true'
    this.drawing.begin(pressed ? null : kind)
    this.refresh()
  }

  private step(work: () => void): void {
    work()
    this.drawing.load()
    this.selected = null
    this.change()
  }

  /** What was checked is not what is drawn any more. */
  private change(): void {
    this.version += 1
    this.apply.disabled = true
    this.drawing.showPlan(null)
    replace(this.verdict)
    this.refresh()
  }

  private refresh(): void {
    this.undo.disabled = !kept.canUndo
    this.redo.disabled = !kept.canRedo
    for (const tool of this.tools) tool.setAttribute('aria-pressed', String(tool.dataset.kind === this.drawing.kind))
    this.summary.textContent = this.drawing.kind ? HINTS[SHAPE_OF[this.drawing.kind]] : describe()
    const shape = kept.shapes.find((s) => s.id === this.selected)
    this.shape.hidden = !shape
    if (shape) replace(this.shape, ...shapePanel(shape, kept, (work) => this.step(work)))
  }

  private body(): PlanWish {
    return {
      field: { ...toGeoJson(kept.shapes, this.app.projection) },
      implement_width_m: this.width.value ? Number(this.width.value) : null,
      headland_passes: Number(this.passes.value),
      is_crop_gone: this.gone.checked,
    }
  }

  private async check(): Promise<void> {
    const version = this.version
    const reply = await this.app.attempt(api.plan(this.body()))
    if (!reply || version !== this.version) return
    this.drawing.showPlan(reply)
    replace(this.verdict, ...verdict(reply))
    this.apply.disabled = !reply.ok
  }

  private async use(): Promise<void> {
    const text = say('usePlanBody')
    const yes = this.app.store.seat === 'you' ? say('useThisPlan') : say('takeControlAndUseIt')
    if (!(await this.app.dialogs.confirm(say('askUsePlan'), [text], yes))) return
    if (!(await takeSeat(this.app))) return
    if (await this.app.attempt(api.applyPlan(this.body()))) {
      this.app.toasts.show('info', say('planIsUsed'))
    }
  }

  close(): void {
    this.recorder.close()
  }
}

function verdict(reply: PlanReply): HTMLElement[] {
  const figures = say('planFigures', {
    length: metres(reply.length_m),
    area: area(reply.area_m2),
    time: duration(reply.time_s),
  })
  if (reply.ok) return [el('p', { class: 'tag good' }, say('planIsGood')), el('p', {}, figures), ...leftOut(reply)]
  return [
    el('p', { class: 'tag bad' }, say('planIsBad')),
    el('ol', { class: 'reasons' }, ...reply.reasons.map(({ text }) => el('li', {}, text))),
    ...leftOut(reply),
  ]
}

/** Ground that the plan does not work, though it can be driven. */
function leftOut(reply: PlanReply): HTMLElement[] {
  if (!reply.warnings.length) return []
  return [
    el('p', { class: 'tag warn' }, say('groundIsLeftOut')),
    el('ul', { class: 'reasons' }, ...reply.warnings.map((text) => el('li', { lang: langOf(text) }, text))),
  ]
}

function describe(): string {
  if (!kept.shapes.length) return say('chooseWhatToDraw')
  const counts = new Map<Kind, number>()
  let inside = 0
  for (const { kind, points } of kept.shapes) {
    counts.set(kind, (counts.get(kind) ?? 0) + 1)
    if (SHAPE_OF[kind] === 'polygon') inside += (kind === 'boundary' ? 1 : -1) * areaM2(points)
  }
  const rows = kept.shapes.filter((s) => s.kind === 'row').reduce((sum, s) => sum + lengthM(s.points), 0)
  const parts = [...counts].map(([kind, n]) => say(COUNTS[kind], { count: n }))
  const sizes = [inside > 0 && area(inside), rows > 0 && say('rowsLength', { length: metres(rows) })]
  return [parts.join(', '), ...sizes].filter(Boolean).join(' · ')
}

function numberInput(value: number | null, min: number, max: number, step: number): HTMLInputElement {
  return el('input', { type: 'number', class: 'field-input', value, min, max, step })
}

function iconButton(name: IconName, title: string, action: () => void): HTMLButtonElement {
  return el('button', { type: 'button', class: 'icon-button', title, 'aria-label': title, onclick: action }, icon(name))
}
