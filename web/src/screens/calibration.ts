/** Calibrations in four steps: what will happen, the drive, old and new values, taking them over. */

import { api } from '../api.ts'
import type { App } from '../app.ts'
import { el, update } from '../dom.ts'
import { duration, fixed, words } from '../format.ts'
import { icon } from '../icons.ts'
import { seatButton } from '../shell/seat.ts'
import { CoverageRing, errorPlot } from './compass.ts'
import type {
  CalibrationProgress,
  CalibrationChange,
  CalibrationFound,
  CalibrationKind,
  Calibrations,
} from '../wire.ts'
import { langOf, named, say } from '../say.ts'

const DIGITS: Record<string, number> = { m: 4, uT: 2, deg: 2, '%': 0, '': 3 }

export class CalibrationCard {
  readonly node = el('section', { class: 'card stack calibration', 'aria-label': say('calibration') })
  private readonly body = el('div', { class: 'stack-tight wide', 'aria-live': 'polite' })
  private readonly bar = el('progress', { max: 1, 'aria-label': say('progressOfTheCalibration') })
  private readonly step = el('p', { class: 'muted' })
  private readonly ring = new CoverageRing()
  private known: Calibrations | null = null
  private shown = ''
  private asked = 0
  private changing = 0
  private readonly undo: (() => void)[]

  constructor(private readonly app: App) {
    const seat = seatButton(app)
    this.node.append(el('div', { class: 'card-head' }, el('h2', {}, say('calibration')), seat.node), this.body)
    this.undo = [app.store.on('state', () => this.follow()), app.store.on('seat', () => this.draw()), seat.done]
  }

  close(): void {
    for (const undo of this.undo) undo()
  }

  /** Hidden where no robot runs that could be calibrated. */
  async look(): Promise<void> {
    const source = this.app.session.source
    this.node.hidden = source === 'replay' || source === 'description'
    if (!this.node.hidden) await this.ask()
  }

  /** What a change answers is newer than what was asked for before it or meanwhile. */
  private async ask(): Promise<void> {
    if (this.changing) return
    const asked = ++this.asked
    const found = await this.app.attempt(api.calibrations())
    if (found && asked === this.asked) this.show(found)
  }

  private async change(...words: Parameters<typeof api.calibrate>): Promise<boolean> {
    this.asked++
    this.changing++
    const found = await this.app.attempt(api.calibrate(...words))
    this.changing--
    if (found) this.show(found)
    return found !== null
  }

  private show(known: Calibrations): void {
    this.known = known
    this.shown = stage(known.now)
    this.draw()
  }

  /** The newest state: another stage is asked for and drawn anew, progress within one only moves. */
  private follow(): void {
    if (!this.known) return
    const now = this.app.store.state?.calibration ?? null
    if (stage(now) !== this.shown) {
      this.shown = stage(now)
      void this.ask()
    } else if (now?.phase === 'driving') this.progress(now)
  }

  private progress(now: CalibrationProgress): void {
    this.bar.value = now.share
    this.ring.show(now.directions)
    const motion = now.motion ? words(now.motion) : say('atRest')
    const text = say('calibrationStep', { share: Math.round(now.share * 100), motion })
    if (this.step.textContent !== text) this.step.textContent = text
  }

  private draw(): void {
    if (this.known) update(this.body, ...this.content(this.known))
  }

  private content(known: Calibrations): Element[] {
    const now = known.now
    if (now && (now.phase === 'driving' || now.phase === 'computing')) return this.underWay(now)
    if (now?.phase === 'found' && known.found) return this.result(now, known.found)
    return this.choice(known, now)
  }

  private underWay(now: CalibrationProgress): Element[] {
    if (now.phase === 'driving') this.progress(now)
    else this.step.textContent = say('workingItOut')
    this.ring.show(now.directions)
    const cancel = el(
      'button',
      { type: 'button', class: 'button danger', onclick: () => void this.change('cancel') },
      icon('cancel', 20),
      say('cancel'),
    )
    return [
      el('h3', {}, this.title(now.kind)),
      el('p', {}, say('keepAnEyeOnIt')),
      ...(now.directions ? [this.ring.node] : []),
      ...(now.phase === 'driving' ? [this.bar, this.step, cancel] : [this.step]),
    ]
  }

  private result(now: CalibrationProgress, found: CalibrationFound): HTMLElement[] {
    const mine = this.app.store.seat === 'you'
    const leave = el(
      'button',
      { type: 'button', class: 'button', onclick: () => void this.change('cancel') },
      found.settings.length && found.ok ? say('leaveAsItWas') : say('close'),
    )
    const accept = el(
      'button',
      { type: 'button', class: 'button primary', disabled: !mine, onclick: () => void this.accept() },
      icon('check', 20),
      say('useTheseValues'),
    )
    const verdict = found.ok
      ? found.settings.length
        ? say('calibrationIsGood')
        : say('allAsItShouldBe')
      : say('doNotUseIt')
    this.ring.show(now.directions)
    return [
      el('h3', {}, this.title(now.kind)),
      el('p', { class: found.ok ? '' : 'form-error' }, verdict),
      ...found.reasons.map((reason) => el('p', { class: 'form-error', lang: langOf(reason) }, words(reason))),
      el(
        'div',
        { class: 'calibration-pictures' },
        now.directions && this.ring.node,
        found.errors_deg && errorPlot(...found.errors_deg),
      ),
      el('div', { class: 'table-scroll' }, table(found.changes)),
      el('div', { class: 'button-row' }, found.ok && found.settings.length > 0 && accept, leave),
      ...(mine || !found.ok ? [] : [el('p', { class: 'small muted' }, say('calibrationNeedsSeat'))]),
    ]
  }

  private choice(known: Calibrations, now: CalibrationProgress | null): HTMLElement[] {
    const measured = known.settings.length
      ? el('p', { class: 'small' }, say('measuredOf', { settings: known.settings.join(', ') }))
      : el('p', { class: 'small muted' }, say('nothingMeasured'))
    const back = el(
      'button',
      { type: 'button', class: 'button', disabled: this.app.store.seat !== 'you', onclick: () => void this.goBack() },
      say('undoTheNewest'),
    )
    return [
      ...(now?.phase === 'failed'
        ? [
            el(
              'p',
              { class: 'form-error', role: 'alert' },
              say('calibrationEnded', { title: this.title(now.kind), reason: now.reason }),
            ),
          ]
        : []),
      ...(known.broken ? [el('p', { class: 'form-error' }, known.broken)] : []),
      el('div', { class: 'calibration-kinds' }, ...known.kinds.map((kind) => this.kind(kind))),
      measured,
      ...(known.can_undo ? [back] : []),
    ]
  }

  private kind(kind: CalibrationKind): HTMLElement {
    const start = el(
      'button',
      {
        type: 'button',
        class: 'button',
        disabled: this.app.store.seat !== 'you',
        onclick: () => void this.start(kind),
        'aria-label': say('calibrateThis', { title: named(kind.title) }),
      },
      say('calibrate'),
    )
    return el(
      'div',
      { class: 'calibration-kind' },
      el('div', {}, el('h3', {}, named(kind.title)), el('p', { class: 'small muted' }, named(kind.about))),
      start,
    )
  }

  private async start(kind: CalibrationKind): Promise<void> {
    const go = await this.app.dialogs.confirm(
      named(kind.title),
      [
        el('p', {}, named(kind.about)),
        el('p', {}, say('drivesByItself', { time: duration(kind.duration_s), ground: named(kind.ground) })),
        el('p', {}, say('endsAtOnce')),
      ],
      say('driveNow'),
    )
    if (go) await this.change('start', { kind: kind.name })
  }

  private async accept(): Promise<void> {
    if (await this.change('accept')) this.app.toasts.show('info', say('calibrationIsUsed'))
  }

  private async goBack(): Promise<void> {
    if (await this.change('undo')) this.app.toasts.show('info', say('calibrationIsUndone'))
  }

  private title(name: string): string {
    return named(this.known?.kinds.find((kind) => kind.name === name)?.title ?? name)
  }
}

function stage(now: CalibrationProgress | null): string {
  return now ? `${now.kind} ${now.phase} ${now.reason}` : ''
}

function table(changes: CalibrationChange[]): HTMLElement {
  const heads = [say('valueBefore'), say('valueNow'), '± 1 σ'].map((name) => el('th', { class: 'number' }, name))
  return el(
    'table',
    {},
    el('thead', {}, el('tr', {}, el('th', {}, say('value')), ...heads)),
    el(
      'tbody',
      {},
      ...changes.map((change) => {
        const digits = DIGITS[change.unit] ?? 3
        const value = (number: number | null): HTMLElement =>
          el('td', { class: 'number mono' }, fixed(number, Number.isInteger(number) && change.unit === '' ? 0 : digits))
        const unit = change.unit === 'uT' ? 'µT' : change.unit === 'deg' ? '°' : change.unit
        return el(
          'tr',
          {},
          el('td', { lang: langOf(change.label) }, unit ? `${named(change.label)} (${unit})` : named(change.label)),
          value(change.before),
          value(change.after),
          value(change.std),
        )
      }),
    ),
  )
}
