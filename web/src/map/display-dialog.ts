/** Adding a display to the map, and changing one. */

import { Display } from '../displays/display.ts'
import type { LayerGroup, ToolId } from '../displays/host.ts'
import { filled } from '../displays/options.ts'
import type { Option, Options, OptionValue } from '../displays/options.ts'
import type { Source } from '../displays/sources.ts'
import { readTopicId, titleOf } from '../displays/topics.ts'
import { DISPLAY_TYPES, typeOf } from '../displays/types.ts'
import type { DisplayType } from '../displays/types.ts'
import { el, replace } from '../dom.ts'
import { icon } from '../icons.ts'
import type { Choice } from '../shell/dialogs.ts'
import type { MapView } from './view.ts'
import { named, say } from '../say.ts'

const PICTURE_PX = 256
/** Between two looks at the topics that there are, while the dialog is open. */
const LOOK_MS = 2000

export async function addDisplay(view: MapView, useTool: (tool: ToolId) => void): Promise<void> {
  let options: Options = {}
  const type = el(
    'select',
    { onchange: () => fill() },
    ...DISPLAY_TYPES.map(({ id, title }) => el('option', { value: id }, title)),
  )
  type.value = 'odometry'
  const chosen = (): DisplayType => typeOf(type.value) as DisplayType
  const offer = new SourceOffer(view)
  const title = el('input', { type: 'text', class: 'field-input', maxlength: 40, autocomplete: 'off' })
  const fields = el('div', { class: 'option-grid' })
  const titleField = el('label', { class: 'field' }, el('span', {}, say('name')), title)
  const fill = (): void => {
    const { kind } = chosen()
    offer.show(chosen())
    titleField.hidden = kind === 'tool'
    title.value = chosen().title
    options = filled(chosen().options)
    replace(fields, ...optionFields(chosen().options, options, (name, value) => (options[name] = value)))
  }
  fill()
  const timer = setInterval(() => void offer.look(), LOOK_MS)
  void offer.look()
  const kindField = el('label', { class: 'field' }, el('span', {}, say('displayKind')), type)
  const body = [kindField, ...offer.nodes, titleField, fields]
  const isConfirmed = await view.app.dialogs.confirm(say('addADisplay'), body, say('addIt'))
  clearInterval(timer)
  if (!isConfirmed) return
  const made = chosen()
  if (made.kind === 'tool') useTool(made.tool)
  else if (!view.displays.make(made.id, title.value.trim() || made.id, offer.source.value, options))
    view.app.toasts.show('warn', say('displayNotAdded'))
}

/** What a kind of display can show; what comes up meanwhile is offered too. */
class SourceOffer {
  readonly source = el('select')
  readonly nodes: HTMLElement[]
  private readonly about = el('p', { class: 'muted small' })
  private readonly field = el('label', { class: 'field' }, el('span', {}, say('showsWhat')), this.source)
  private readonly problems = el('p', { class: 'muted small topic-problems' }, say('lookingForTopics'))
  private type: DisplayType | null = null
  private offered = ''

  constructor(private readonly view: MapView) {
    this.nodes = [this.about, this.field, this.problems]
  }

  show(type: DisplayType): void {
    this.type = type
    const { kind } = type
    this.problems.hidden = kind === 'tool' || kind === 'tiles' || (kind === 'shapes' && type.needsNoSource === true)
    this.fill(type)
  }

  async look(): Promise<void> {
    const networks = await this.view.displays.findTopics()
    if (this.type) this.fill(this.type)
    this.problems.textContent = networks
      .filter(({ problem }) => problem)
      .map(({ problem }) => problem)
      .join(' ')
  }

  /** Leaves the list as it is where nothing is new: it may be open. */
  private fill(type: DisplayType): void {
    const sources = this.view.displays.sources(type)
    const found = JSON.stringify([type.id, sources.map(({ id, title, network }) => [id, title, network])])
    if (found === this.offered) return
    this.offered = found
    const before = this.source.value
    replace(this.source, ...sourceOptions(sources))
    if (sources.some(({ id }) => id === before)) this.source.value = before
    this.field.hidden = type.kind === 'tool' || sources.length === 0
    this.about.textContent = describe(type, sources.length)
  }
}

/** The robot's own first, then the topics of each network below its name. */
function sourceOptions(sources: Source[]): HTMLElement[] {
  const networks = [...new Set(sources.map(({ network }) => network))]
  const options = (network: string | undefined): HTMLElement[] =>
    sources
      .filter((one) => one.network === network)
      .map(({ id, title }) => el('option', { value: id }, network ? `${title} (${named(network)})` : title))
  return networks.flatMap((network) =>
    network === undefined ? options(network) : el('optgroup', { label: named(network) }, ...options(network)),
  )
}

function describe(type: DisplayType, sources: number): string {
  if (type.kind === 'tool') return say('toolOfMap', { reads: type.reads })
  const isFine = sources > 0 || (type.kind === 'shapes' && type.needsNoSource)
  return say(isFine ? 'readsWhat' : 'readsButNothing', { reads: type.reads })
}

function networkOf(source: string): string {
  return (
    { ros1: 'ROS 1', ros2: 'ROS 2', dds: say('rosOnDds'), recording: say('theRecording') }[source] ??
    source.replace(/^bag:/, '')
  )
}

type Set = (name: string, value: OptionValue) => void

function optionFields(options: Option[], values: Options, set: Set): HTMLElement[] {
  return options.map((option) => {
    const unit = option.unit ? `, ${option.unit}` : ''
    if (typeof option.value === 'boolean') {
      const box = el('input', {
        type: 'checkbox',
        checked: values[option.name] === true,
        onchange: () => set(option.name, box.checked),
      })
      return el('label', { class: 'check' }, box, option.label)
    }
    return el(
      'label',
      { class: 'field' },
      el('span', {}, `${option.label}${unit}`),
      control(option, values[option.name], (value) => set(option.name, value)),
    )
  })
}

function control(option: Option, value: OptionValue, set: (value: OptionValue) => void): HTMLElement {
  if (option.choices) {
    const select = el(
      'select',
      { onchange: () => set(select.value) },
      ...option.choices.map((name) => el('option', { value: name, selected: name === value }, named(name))),
    )
    return select
  }
  if (option.name === 'image') return pictureInput(set)
  const isNumber = typeof option.value === 'number'
  const isColour = String(option.value).startsWith('#')
  const input = el('input', {
    type: isNumber ? 'number' : isColour ? 'color' : 'text',
    class: isColour ? 'colour-input' : 'field-input',
    value: String(value),
    min: option.min,
    max: option.max,
    step: option.step,
    autocomplete: 'off',
    onchange: () => {
      if (!isNumber) set(input.value)
      else if (input.value !== '' && input.validity.valid) set(Number(input.value))
    },
  })
  return input
}

/** A picture file, made small enough to be kept in a saved view. */
function pictureInput(set: (value: string) => void): HTMLElement {
  const input = el('input', { type: 'file', accept: 'image/*', class: 'field-input', onchange: () => void read() })
  const read = async (): Promise<void> => {
    const file = input.files?.[0]
    const bitmap = file && (await createImageBitmap(file).catch(() => null))
    if (!bitmap) return
    const by = Math.min(1, PICTURE_PX / Math.max(bitmap.width, bitmap.height))
    const canvas = el('canvas', { width: Math.round(bitmap.width * by), height: Math.round(bitmap.height * by) })
    canvas.getContext('2d')?.drawImage(bitmap, 0, 0, canvas.width, canvas.height)
    set(canvas.toDataURL())
  }
  return input
}

/** Order, options and removal of one entry of the layer list. */
export async function editGroup(view: MapView, group: LayerGroup): Promise<void> {
  const body: HTMLElement[] = [
    el(
      'div',
      { class: 'button-row' },
      mover(view, group, -1, say('furtherUp')),
      mover(view, group, 1, say('furtherDown')),
    ),
  ]
  const choices: Choice<string>[] = [{ label: say('done'), value: 'done', kind: 'primary' }]
  if (group instanceof Display) {
    const { type, options } = group
    body.push(
      el(
        'p',
        { class: 'muted small' },
        type.title === group.title ? say('readsWhat', { reads: type.reads }) : say('typeReads', type),
      ),
    )
    const topic = readTopicId(group.config.source)
    if (topic) {
      const shown = { topic: titleOf(topic.name), network: networkOf(topic.source) }
      body.push(el('p', { class: 'small' }, say('showsTopic', shown)))
    }
    for (const line of [group.condition.note, group.condition.leftOut])
      if (line) body.push(el('p', { class: 'small' }, line))
    body.push(
      el(
        'div',
        { class: 'option-grid' },
        ...optionFields(type.options, options, (name, value) => {
          group.setOptions({ ...group.options, [name]: value })
          view.remember()
        }),
      ),
    )
    if (group.removable) choices.unshift({ label: say('remove'), value: 'remove', kind: 'danger' })
  }
  const answer = await view.app.dialogs.ask(group.title, body, choices)
  if (answer === 'remove' && group instanceof Display) view.displays.remove(group)
}

function mover(view: MapView, group: LayerGroup, by: -1 | 1, label: string): HTMLElement {
  return el(
    'button',
    { type: 'button', class: 'button', onclick: () => view.moveGroup(group, view.groups.indexOf(group) + by) },
    icon(by < 0 ? 'up' : 'down', 20),
    label,
  )
}
