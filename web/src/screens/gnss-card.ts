/** The GNSS receiver as a person in the field needs it: fix, sky, corrections and its line. */

import type { App } from '../app.ts'
import { el, replace, setAttr, setText, svg } from '../dom.ts'
import { fixed, metres, NONE } from '../format.ts'
import type { ReceiverState, SeenSatellite, SensorDoubt } from '../wire.ts'
import { readSeenSatellite } from '../wire.ts'
import { tellSince } from './gate-card.ts'
import { named, say } from '../say.ts'

type Tone = 'plain' | 'good' | 'warn' | 'bad'

export interface Fact {
  name: string
  text: string
  tone: Tone
}

const LATE_FIX_S = 2
const LATE_STATUS_S = 5 // from then on the robot reports no satellites any more
const OLD_CORRECTION_S = { warn: 10, bad: 60 } // a carrier fix outlives half a minute without them
const POOR_HDOP = { warn: 2, bad: 5 }
const STATES: Record<number, [string, Tone]> = {
  0: [say('noFix'), 'bad'],
  1: [say('singleFixNoCorrections'), 'warn'],
  2: ['DGNSS', 'warn'],
  4: [say('rtkFixed'), 'good'],
  5: [say('rtkFloat'), 'warn'],
}
const WITHOUT_SATELLITES: Record<string, string> = { 'dead reckoning': say('deadReckoning'), held: say('heldPlace') }
const LONG_TEXT = 50 // letters, that take a line of their own

/** The receiver's state in words; a late fix counts as no fix. */
export function readFix(receiver: ReceiverState | null): { text: string; tone: Tone } {
  if (!receiver) return { text: say('nothingHeardYet'), tone: 'bad' }
  if (receiver.fix_age_s === null) return { text: say('noFixYet'), tone: 'bad' }
  if (isLate(receiver)) return { text: say('noFixSince', { time: fixed(receiver.fix_age_s, 0, 's') }), tone: 'bad' }
  if (receiver.unmeasured) {
    const name = WITHOUT_SATELLITES[receiver.unmeasured] ?? receiver.unmeasured
    return { text: say('noSatellites', { name }), tone: 'bad' }
  }
  const [text, tone] = STATES[receiver.quality] ?? [say('qualityNumber', { number: receiver.quality }), 'warn']
  return { text, tone }
}

/** Line by line what is reported, and what is missing as such. */
export function readFacts(receiver: ReceiverState, doubt: SensorDoubt | undefined, t_s: number): Fact[] {
  const facts = [lastFix(receiver), accuracy(receiver), satellites(receiver)]
  if (receiver.position_trouble) facts.unshift(fact(say('noPosition'), receiver.position_trouble, 'bad'))
  if (receiver.satellites.length) facts.push(signal(receiver.satellites.map(readSeenSatellite)))
  facts.push(dilution(receiver), corrections(receiver))
  if (receiver.caster) facts.push(caster(receiver))
  if (receiver.line_trouble) facts.push(fact(say('line'), receiver.line_trouble, 'bad'))
  else if (receiver.device) facts.push(fact(say('line'), say('noBrokenMessagesReported')))
  if (receiver.unread.length) facts.push(fact(say('notRead'), receiver.unread.join(', ')))
  if (doubt) {
    const since = [named(doubt.state), tellSince(t_s, doubt.since_s)].filter(Boolean).join(' ')
    facts.push(fact(say('doubt'), doubt.reason ? `${since}: ${doubt.reason}` : since, 'bad'))
  }
  return facts
}

function fact(name: string, text: string, tone: Tone = 'plain'): Fact {
  return { name, text, tone }
}

function isLate({ fix_age_s }: ReceiverState): boolean {
  return fix_age_s === null || fix_age_s > LATE_FIX_S
}

function lastFix(receiver: ReceiverState): Fact {
  if (receiver.fix_age_s === null) return fact(say('lastFix'), say('noneSinceTheStart'), 'bad')
  const age = fixed(receiver.fix_age_s, isLate(receiver) ? 0 : 1, 's')
  if (isLate(receiver)) return fact(say('lastFix'), say('timeAgo', { time: age }), 'bad')
  const { rate_hz: rate } = receiver
  return fact(say('lastFix'), rate === null ? say('timeAgo', { time: age }) : say('timeAgoRate', { time: age, rate }))
}

function accuracy(receiver: ReceiverState): Fact {
  const name = say('accuracy1')
  if (isLate(receiver) || receiver.std_m === null) return fact(name, say('notKnown'), 'bad')
  const std = metres(receiver.std_m)
  return fact(name, keepUnits(say('accuracyText', { std })))
}

/** What is said where a receiver reports no satellites, or not any more. */
function silence({ is_simulated, status_age_s }: ReceiverState): Pick<Fact, 'text' | 'tone'> {
  if (status_age_s !== null && status_age_s > LATE_STATUS_S) {
    return { text: say('notReportedFor', { time: fixed(status_age_s, 0, 's') }), tone: 'bad' }
  }
  return {
    text: say(is_simulated ? 'notReportedInTheSimulation' : 'notReported'),
    tone: is_simulated ? 'plain' : 'warn',
  }
}

function satellites(receiver: ReceiverState): Fact {
  if (!receiver.in_view_count) return { name: say('satellites'), ...silence(receiver) }
  const text = say('satellitesUsed', { used: receiver.used_count, seen: receiver.in_view_count })
  return fact(say('satellites'), text, receiver.used_count ? 'plain' : 'bad')
}

function signal(seen: SeenSatellite[]): Fact {
  const heard = seen.filter((each) => each.snr_db > 0)
  const used = heard.filter((each) => each.is_used)
  const values = (used.length ? used : heard).map((each) => each.snr_db).sort((a, b) => a - b)
  if (!values.length) return fact(say('signal'), say('noSatelliteIsHeard'), 'bad')
  const middle = values[Math.floor(values.length / 2)]
  return fact(say('signal'), say('signalText', { median: middle, best: values[values.length - 1] }))
}

function dilution(receiver: ReceiverState): Fact {
  const named = { HDOP: receiver.hdop, PDOP: receiver.pdop, VDOP: receiver.vdop }
  const told = Object.entries(named).flatMap(([name, value]) => (value === null ? [] : [`${name} ${fixed(value, 1)}`]))
  if (!told.length) return { name: say('dilution'), ...silence(receiver) }
  return fact(say('dilution'), keepUnits(told.join(', ')), grade(receiver.hdop ?? 0, POOR_HDOP))
}

function corrections(receiver: ReceiverState): Fact {
  const age_s = receiver.correction_age_s
  if (age_s !== null) return correctionsOfAge(age_s, receiver.correction_use_ratio)
  if (receiver.caster_state === 'failed') return fact(say('corrections'), say('noCorrections'), 'bad')
  return { name: say('corrections'), ...silence(receiver) }
}

function correctionsOfAge(age_s: number, use_ratio: number | null): Fact {
  const tone = use_ratio === 0 ? 'bad' : grade(age_s, OLD_CORRECTION_S)
  return fact(say('corrections'), tellUse(fixed(age_s, 1, 's'), use_ratio), tone)
}

/** Corrections that come may be of no use to the receiver, which then says so. */
function tellUse(time: string, ratio: number | null): string {
  if (ratio === null) return say('timeOld', { time })
  return ratio > 0 ? say('timeOldUsed', { time, share: fixed(100 * ratio, 0) }) : say('timeOldUnused', { time })
}

function caster(receiver: ReceiverState): Fact {
  const { caster_state, correction_trouble, correction_hz } = receiver
  if (caster_state === 'failed') return fact(say('caster'), correction_trouble, 'bad')
  const at = receiver.caster.replace(/^\w+:\/\//, '')
  const name = say('casterName', { name: at })
  if (caster_state === 'asked') return fact(name, say('askedNothingCameYet'), 'warn')
  if (correction_hz === null) return fact(name, say('casterConnected'))
  return fact(name, say('casterRate', { rate: fixed(correction_hz, 1) }))
}

/** No line ends between a number and its name or unit. */
function keepUnits(text: string): string {
  return text.replace(/ (?=cm|m\b|\d)/g, '\u00a0')
}

function grade(value: number, limits: { warn: number; bad: number }): Tone {
  return value > limits.bad ? 'bad' : value > limits.warn ? 'warn' : 'plain'
}

/** Built anew only where its text changed. */
export class GnssCard {
  private readonly state = el('span', { class: 'tag', role: 'status' })
  private readonly simulated = el('span', { class: 'tag note', hidden: true }, say('simulated'))
  private readonly device = el('span', { class: 'muted' })
  private readonly facts = el('dl', { class: 'facts plain' })
  private readonly sky = new SkyPlot()
  readonly node = el(
    'section',
    { class: 'card gnss-card', 'aria-label': say('gnssReceiver') },
    el('div', { class: 'gnss-head' }, el('h2', {}, say('gnssReceiver')), this.state, this.simulated, this.device),
    el('div', { class: 'gnss-body' }, this.facts, this.sky.node),
  )
  private shown = ''

  constructor(private readonly app: App) {}

  update(): void {
    const { receiver, state } = this.app.store
    this.node.hidden = this.app.session.source === 'description'
    const { text, tone } = readFix(receiver)
    setText(this.state, text)
    setAttr(this.state, 'class', `tag ${tone}`)
    this.simulated.hidden = !receiver?.is_simulated
    setText(this.device, receiver?.device ?? '')
    const doubt = state?.doubts.find(({ sensor }) => sensor === 'gnss')
    this.showFacts(receiver ? readFacts(receiver, doubt, state?.t_s ?? 0) : [])
    this.sky.show(receiver?.satellites.map(readSeenSatellite) ?? [])
  }

  private showFacts(facts: Fact[]): void {
    const text = JSON.stringify(facts)
    if (text === this.shown) return
    this.shown = text
    replace(
      this.facts,
      ...facts.map((each) =>
        el(
          'div',
          { class: each.text.length > LONG_TEXT ? 'long' : null },
          el('dt', {}, each.name),
          el('dd', { class: each.tone }, each.text || NONE),
        ),
      ),
    )
  }
}

const RADIUS = 88
const MARGIN = 14
const CIRCLES_DEG = [0, 30, 60]
const STRONG_DB = 50
const DOT = { least: 2.5, most: 6.5 }
const WINDS: [string, number][] = [
  [say('windN'), 0],
  [say('windE'), 90],
  [say('windS'), 180],
  [say('windW'), 270],
]

/** Where the satellites stand: north up, the zenith in the middle; a strong one is large, a used one filled. */
class SkyPlot {
  private readonly dots = svg('g', {})
  private readonly picture = svg(
    'svg',
    {
      viewBox: `${-RADIUS - MARGIN} ${-RADIUS - MARGIN} ${2 * (RADIUS + MARGIN)} ${2 * (RADIUS + MARGIN)}`,
      role: 'img',
    },
    ...CIRCLES_DEG.map((deg) => svg('circle', { class: 'axis', r: radiusOf(deg) })),
    svg('path', { class: 'axis', d: `M${-RADIUS} 0H${RADIUS}M0 ${-RADIUS}V${RADIUS}` }),
    ...WINDS.map(([name, azimuth_deg]) => wind(name, azimuth_deg)),
    this.dots,
  )
  readonly node = el(
    'figure',
    { class: 'sky', hidden: true },
    this.picture,
    el('figcaption', { class: 'muted' }, say('skyLegend')),
  )

  show(seen: SeenSatellite[]): void {
    const up = seen.filter(({ elevation_deg, azimuth_deg }) => elevation_deg >= 0 && azimuth_deg >= 0)
    this.node.hidden = !up.length
    const used = up.filter((each) => each.is_used).length
    setAttr(this.picture, 'aria-label', say('skyText', { all: up.length, used }))
    replace(this.dots, ...up.sort((a, b) => Number(a.is_used) - Number(b.is_used)).map(dot))
  }
}

function radiusOf(elevation_deg: number): number {
  return RADIUS * (1 - elevation_deg / 90)
}

function place(azimuth_deg: number, radius: number): { x: number; y: number } {
  const angle = (azimuth_deg * Math.PI) / 180
  return { x: radius * Math.sin(angle), y: -radius * Math.cos(angle) }
}

function wind(name: string, azimuth_deg: number): SVGTextElement {
  const { x, y } = place(azimuth_deg, RADIUS + MARGIN / 2)
  return svg('text', { x, y: y + 4 }, name)
}

function dot(satellite: SeenSatellite): SVGCircleElement {
  const { system, number, elevation_deg, azimuth_deg, snr_db, is_used } = satellite
  const { x, y } = place(azimuth_deg, radiusOf(elevation_deg))
  const share = Math.min(snr_db / STRONG_DB, 1)
  const heard = snr_db > 0 ? `${snr_db} dB-Hz` : say('notHeard')
  const figures = { name: `${system} ${number}`, elevation: elevation_deg, signal: heard }
  const text = say(is_used ? 'satelliteUsed' : 'satelliteSeen', figures)
  return svg(
    'circle',
    {
      class: is_used ? 'used' : 'seen',
      cx: x.toFixed(1),
      cy: y.toFixed(1),
      r: (DOT.least + share * (DOT.most - DOT.least)).toFixed(1),
    },
    svg('title', {}, text),
  )
}
