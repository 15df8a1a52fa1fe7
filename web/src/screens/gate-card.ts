/** What the last gate before the motors does and why, the list before the start, and the sensors. */

import type { App } from '../app.ts'
import { el, replace, setAttr, setText } from '../dom.ts'
import { words } from '../format.ts'
import { icon } from '../icons.ts'
import type { GateState, SensorDoubt, SensorState, StartCheck, State } from '../wire.ts'
import { readStartCheck } from '../wire.ts'
import { named, say } from '../say.ts'

type Tone = 'plain' | 'good' | 'note' | 'warn' | 'bad'

const GATE_TONES: Record<GateState, Tone> = {
  standby: 'plain',
  checking: 'note',
  driving: 'good',
  slowed: 'warn',
  held: 'warn',
  stopped: 'bad',
  'by hand': 'note',
}
const SENSOR_TONES: Record<SensorState, Tone> = {
  fine: 'good',
  late: 'warn',
  silent: 'bad',
  frozen: 'bad',
  contradicted: 'bad',
}
const NOTHING: Said = { text: '', kinds: [] }
/** Sensors of every robot; those that packages add stand by their own names. */
const SENSOR_NAMES: Record<string, string> = {
  gnss: 'GNSS',
  compass: say('compass'),
  gyro: say('gyro'),
  wheels: say('wheels'),
  camera: say('camera'),
  clock: say('clock'),
}

/** A text, and the kinds of its fact and of those inside it. */
interface Said {
  text: string
  kinds: string[]
}

/** The reason beside the gate's state; one that the banner of a stop shows already is left out. */
export function tellWhy(state: State): string {
  return sentence(findWhy(state).text)
}

function findWhy(state: State): Said {
  const { gate, mission } = state
  const all = [
    said(state.reason, state.reason_kinds),
    gate?.state === 'driving' ? NOTHING : said(gate?.reason, gate?.reason_kinds),
    said(mission?.reason, mission?.reason_kinds),
    said(mission?.leg && named(mission.leg)),
  ]
  const stop = readBanner(state)
  return all.find((each) => each.text && !repeats(each, stop)) ?? NOTHING
}

/** What the banner of a stop says; that of a replay is the robot's own. */
function readBanner({ mode, stop, stop_kinds }: State): Said {
  return mode === 'replay' ? NOTHING : said(stop, stop_kinds)
}

function said(text?: string, kinds: string[] = []): Said {
  return { text: text ?? '', kinds }
}

/** How long something has been so; not to the second, once that does not matter any more. */
export function tellSince(t_s: number, since_s: number | null | undefined): string {
  if (since_s === null || since_s === undefined) return ''
  const s = Math.max(0, Math.floor(t_s - since_s))
  if (s < 60) return say('forSeconds', { s })
  if (s < 3600) return say('forMinutes', { min: Math.floor(s / 60) })
  return say('forHours', { h: Math.floor(s / 3600), min: Math.floor((s % 3600) / 60) })
}

export interface StartList {
  title: string
  /** What is wrong first, with the reason; then what is good but has a remark. */
  items: { name: string; isGood: boolean; reason: string }[]
  isGood: boolean
  /** While the robot waits for it. */
  isOpen: boolean
}

/** The list before the start, folded once the robot drives; null before it was gone through. */
export function readStartList(state: State): StartList | null {
  const { checks, gate } = state
  if (!checks.length) return null
  const shown = listShown(state)
  const all = checks.map(readStartCheck)
  const bad = all.filter((each) => each.wrong)
  const rank = ({ wrong, remark }: StartCheck): number => (wrong ? 0 : remark ? 1 : 2)
  const waits = gate?.state === 'standby' || gate?.state === 'stopped'
  return {
    title: bad.length
      ? say('checksSomeGood', { good: all.length - bad.length, all: all.length })
      : say('checksAllGood', { all: all.length }),
    items: [...all]
      .sort((a, b) => rank(a) - rank(b))
      .map((each) => ({ name: each.name, isGood: !each.wrong, reason: tellAnew(readFinding(each), shown) })),
    isGood: !bad.length,
    isOpen: gate?.state === 'checking' || (waits && bad.length > 0),
  }
}

function readFinding({ wrong, wrong_kinds, remark, remark_kinds }: StartCheck): Said {
  return wrong ? said(wrong, wrong_kinds) : said(remark, remark_kinds)
}

export interface SensorLine {
  text: string
  tone: Tone
  since: string
  /** Empty where it stands above already. */
  reason: string
}

/**
 * Every sensor of the robot in one line, those that are not fine first; a camera only where the start asks for it.
 */
export function readSensors(state: State, hasCompass: boolean): SensorLine[] {
  const absent = new Set<string>()
  if (!hasCompass) absent.add('compass')
  if (!state.checks.some(([name]) => name === 'camera')) absent.add('camera')
  const shown = listShown(state)
  const lines = state.doubts.map((doubt) => doubtLine(doubt, state.t_s, shown))
  const doubted = new Set(state.doubts.map(({ sensor }) => sensor))
  const names = Object.keys(SENSOR_NAMES)
  const fine = names.filter((name) => !doubted.has(name) && !absent.has(name))
  return [
    ...lines,
    ...fine.map((name): SensorLine => ({ text: SENSOR_NAMES[name], tone: 'good', since: '', reason: '' })),
  ]
}

function doubtLine(doubt: SensorDoubt, t_s: number, shown: Said[]): SensorLine {
  const { sensor, state, since_s } = doubt
  const text = `${SENSOR_NAMES[sensor] ?? sensor} ${named(state)}`
  const reason = tellAnew(said(doubt.reason, doubt.reason_kinds), shown)
  return { text, tone: SENSOR_TONES[state], since: tellSince(t_s, since_s), reason }
}

/** What the card and the banner of a stop say. */
function listShown(state: State): Said[] {
  return [findWhy(state), readBanner(state)]
}

/** The reason, unless it is shown; from now on it is. */
function tellAnew(reason: Said, shown: Said[]): string {
  if (shown.some((each) => repeats(reason, each))) return ''
  shown.push(reason)
  return sentence(reason.text)
}

/** Whether one says what the other says, perhaps with more besides or numbers of another moment. */
function repeats(one: Said, other: Said): boolean {
  if (!one.kinds.length || !other.kinds.length) return one.text !== '' && one.text === other.text
  return one.kinds.includes(other.kinds[0]) || other.kinds.includes(one.kinds[0])
}

function sentence(text: string): string {
  return text && text[0].toUpperCase() + text.slice(1)
}

/** The gate's state and since when, for the head of a card, and the one reason. */
export class GateLine {
  private readonly state = el('span', { class: 'tag', role: 'status' })
  private readonly since = el('span', { class: 'muted' })
  readonly head = el('div', { class: 'gate-line' }, this.since, this.state)
  readonly reason = el('p', { class: 'reason' })

  update(state: State | null): void {
    const gate = state?.gate
    this.state.hidden = !gate
    setText(this.state, gate ? words(gate.state) : '')
    setAttr(this.state, 'class', `tag ${gate ? GATE_TONES[gate.state] : ''}`)
    setText(this.since, gate && state && gate.state !== 'driving' ? tellSince(state.t_s, gate.since_s) : '')
    setText(this.reason, state ? tellWhy(state) : '')
  }
}

/** List and sensors; built anew only where they changed. */
export class GateCard {
  private readonly title = el('summary')
  private readonly items = el('ul')
  private readonly list = el('details', { class: 'start-list', hidden: true }, this.title, this.items)
  private readonly sensors = el('ul', { class: 'sensors', 'aria-label': say('sensors') })
  readonly node = el('div', { class: 'card gate-card', hidden: true }, this.sensors, this.list)
  private shownList = ''
  private shownSensors = ''
  private isOpen = false

  constructor(private readonly app: App) {}

  update(): void {
    const { state } = this.app.store
    this.node.hidden = !state?.gate
    if (!state?.gate) return
    this.showList(readStartList(state))
    this.showSensors(readSensors(state, this.app.robot?.has_compass ?? true))
  }

  private showList(list: StartList | null): void {
    this.list.hidden = !list
    const text = JSON.stringify(list)
    if (!list || text === this.shownList) return
    this.shownList = text
    replace(this.title, icon(list.isGood ? 'check' : 'warning', 18), list.title)
    setAttr(this.title, 'class', list.isGood ? 'good' : 'bad')
    replace(this.items, ...list.items.map(checkLine))
    if (list.isOpen !== this.isOpen) this.list.open = this.isOpen = list.isOpen // else as a person left it
  }

  private showSensors(lines: SensorLine[]): void {
    const text = JSON.stringify(lines)
    if (text === this.shownSensors) return
    this.shownSensors = text
    replace(this.sensors, ...lines.map(sensorLine))
  }
}

function checkLine({ name, isGood, reason }: StartList['items'][number]): HTMLElement {
  return el(
    'li',
    { class: `${isGood ? 'good' : 'bad'}${reason && ' explained'}` },
    icon(isGood ? 'check' : 'warning', 16),
    el('span', {}, words(name), reason !== '' && el('span', { class: 'reason' }, reason)),
    el('span', { class: 'visually-hidden' }, say(isGood ? 'good' : 'notGood')),
  )
}

function sensorLine({ text, tone, since, reason }: SensorLine): HTMLElement {
  if (tone === 'good') {
    return el(
      'li',
      { title: say('fine') },
      icon('check', 14),
      text,
      el('span', { class: 'visually-hidden' }, ` ${say('fine')}`),
    )
  }
  return el(
    'li',
    { class: 'doubt' },
    el('span', { class: `tag ${tone}` }, icon('warning', 14), text),
    el('span', { class: 'muted' }, since),
    el('span', { class: 'reason' }, reason),
  )
}
