/** What was recorded, how much room is left, and playing it back on the same screens. */

import { api } from '../api.ts'
import type { App, Screen } from '../app.ts'
import { el, replace } from '../dom.ts'
import { bytes, duration } from '../format.ts'
import { icon } from '../icons.ts'
import type { RecordingInfo, Recordings, ReplayProgress } from '../wire.ts'
import { dated, langOf, say } from '../say.ts'

/** Files that are called by what they are, in the order of how often people want them. */
const FILE_NAMES: [file: string, text: string][] = [
  ['report.html', say('report')],
  ['weeds.geojson', say('weeds')],
  ['run.mcap', say('recording')],
]
/** Of the program itself. */
const HIDDEN = new Set(['run.lock'])
const SPEEDS = [0.1, 0.5, 1, 2, 5, 10]
const REFRESH_MS = 10_000

export const recordings: Screen = {
  id: 'recordings',
  title: say('recordings'),
  icon: 'recordings',
  async mount(host, app) {
    const list = el('div', { class: 'card table-card' }, el('p', { class: 'empty' }, say('readingTheList')))
    const summary = el('p', { class: 'muted' })
    const replay = new ReplayBar(app)
    const toggle = recordButton(app)
    host.append(
      el(
        'div',
        { class: 'column' },
        el(
          'div',
          { class: 'card row-card' },
          el('div', {}, el('h2', {}, say('recordings')), summary),
          el('div', { class: 'button-row' }, toggle.node, markButton(app)),
        ),
        replay.node,
        list,
      ),
    )
    const refresh = async (): Promise<void> => {
      const found = await app.attempt(api.recordings())
      if (!found) return
      const room = bytes(found.disk_free_bytes)
      summary.textContent = found.current
        ? say('recordingNow', { name: found.current, room })
        : say('recordingNothing', { room })
      show(list, found, replay)
    }
    const timer = setInterval(() => void refresh(), REFRESH_MS)
    toggle.onChange = () => void refresh()
    await refresh()
    return () => {
      clearInterval(timer)
      toggle.close()
      replay.close()
    }
  },
}

function markButton(app: App): HTMLElement {
  return el(
    'button',
    { type: 'button', class: 'button', onclick: () => void mark(app) },
    icon('mark', 20),
    say('markThisMoment'),
  )
}

async function mark(app: App): Promise<void> {
  const text = await app.dialogs.prompt(say('markThisMoment'), say('whatHappened'))
  if (text) await app.command({ kind: 'mark_moment', text }, say('markedInTheRecording'))
}

interface RecordButton {
  node: HTMLElement
  onChange: () => void
  close: () => void
}

/** Begins a recording, or ends the one that is being written. */
function recordButton(app: App): RecordButton {
  const label = el('span')
  const node = el(
    'button',
    {
      type: 'button',
      class: 'button',
      onclick: () => void app.command({ kind: 'control_recording', action: now ? 'stop' : 'start' }),
    },
    icon('record', 20),
    label,
  )
  const made: RecordButton = { node, onChange: () => undefined, close: () => undefined }
  let now: string | undefined
  const update = (): void => {
    const recording = app.store.state?.recording ?? undefined
    node.hidden = recording === undefined
    if (recording === now && label.textContent) return
    now = recording
    label.textContent = now ? say('endTheRecording') : say('record')
    made.onChange()
  }
  update()
  made.close = app.store.on('state', update)
  return made
}

/** A row that is as it was stays: its button keeps the focus, and its list of files stays open. */
function show(list: Element, found: Recordings, replay: ReplayBar): void {
  const rows = found.recordings.map((recording) => row(recording, recording.name === found.current, replay))
  const there = list.querySelectorAll<HTMLElement>('tbody > tr')
  if (!rows.length) replace(list, el('p', { class: 'empty' }, say('noRecordingYet')))
  else if (rows.length !== there.length) replace(list, table(rows))
  else
    rows.forEach((one, i) => {
      if (one.dataset.shown !== there[i]?.dataset.shown) there[i]?.replaceWith(one)
    })
}

function table(rows: HTMLElement[]): HTMLElement {
  return el(
    'table',
    { class: 'recordings' },
    el(
      'thead',
      {},
      el(
        'tr',
        {},
        ...[say('recorded'), say('length'), say('size'), say('result'), say('files'), ''].map((name) =>
          name ? el('th', {}, name) : el('td', {}),
        ),
      ),
    ),
    el('tbody', {}, ...rows),
  )
}

function row(recording: RecordingInfo, current: boolean, replay: ReplayBar): HTMLElement {
  const play = el(
    'button',
    { type: 'button', class: 'button', disabled: current, onclick: () => void replay.open(recording) },
    icon('play', 20),
    say('replay'),
  )
  const when = new Date(recording.utc)
  const isDated = !Number.isNaN(when.getTime())
  const date = isDated ? dated(when) : recording.utc
  const name = recording.name + (recording.profile ? ` · ${recording.profile}` : '')
  return el(
    'tr',
    { class: current ? 'current' : '', 'data-shown': JSON.stringify([recording, current]) },
    el('td', {}, el('strong', {}, date), el('div', { class: 'muted small' }, name)),
    el('td', {}, duration(recording.duration_s)),
    el('td', {}, bytes(recording.size_bytes)),
    el('td', {}, result(recording, current)),
    el('td', {}, fileLinks(recording)),
    el('td', { class: 'number' }, play),
  )
}

function result(recording: RecordingInfo, current: boolean): HTMLElement {
  if (current) return el('span', { class: 'tag note' }, say('recording'))
  if (recording.ok === null) return el('span', { class: 'tag', title: recording.reason }, say('notFinished'))
  return recording.ok
    ? el('span', { class: 'tag good' }, say('done'))
    : el(
        'span',
        {},
        el('span', { class: 'tag bad' }, say('failed')),
        el('span', { class: 'small muted', lang: langOf(recording.reason) }, ` ${recording.reason}`),
      )
}

/** What people look for by its name, and the other files below. */
function fileLinks(recording: RecordingInfo): HTMLElement {
  const { named, others } = sortFiles(recording.files)
  const link = (file: string, text: string): HTMLElement => {
    const href = `/api/v1/recordings/${encodeURIComponent(recording.name)}/${encodeURIComponent(file)}`
    return el('a', { href, download: file }, text)
  }
  return el(
    'div',
    { class: 'file-links' },
    ...named.map(([file, text]) => link(file, text)),
    others.length > 0 &&
      el(
        'details',
        {},
        el('summary', {}, say('filesMore', { count: others.length })),
        el('div', { class: 'file-links' }, ...others.map((file) => link(file, file))),
      ),
  )
}

export function sortFiles(files: string[]): { named: [file: string, text: string][]; others: string[] } {
  const named = FILE_NAMES.filter(([file]) => files.includes(file))
  const known = new Set(named.map(([file]) => file))
  return { named, others: files.filter((file) => !known.has(file) && !HIDDEN.has(file)) }
}

/** Play, pause, seek and speed of the recording that is being replayed. */
class ReplayBar {
  readonly node = el('div', { class: 'card replay-bar', hidden: true })
  private readonly slider = el('input', {
    type: 'range',
    min: 0,
    max: 1,
    step: 0.1,
    value: 0,
    'aria-label': say('timeInTheRecording'),
  })
  private readonly time = el('output')
  private readonly speed = el(
    'select',
    { 'aria-label': say('speed') },
    ...SPEEDS.map((s) => el('option', { value: s, selected: s === 1 }, `${s}×`)),
  )
  private readonly pause = el(
    'button',
    { type: 'button', class: 'button', 'aria-pressed': 'false' },
    icon('pause', 20),
    say('pause'),
  )
  private name: string | null = null
  private seeking = false
  private readonly undo: () => void

  constructor(private readonly app: App) {
    const back = el(
      'button',
      { type: 'button', class: 'button', onclick: () => void app.attempt(api.replay(null, 1, 0)) },
      icon('cancel', 20),
      say('backToLive'),
    )
    this.node.append(el('strong', {}, say('replay')), this.slider, this.time, this.speed, this.pause, back)
    this.slider.addEventListener('input', () => (this.seeking = true))
    this.slider.addEventListener('change', () => void this.apply())
    this.speed.addEventListener('change', () => void this.apply())
    this.pause.addEventListener('click', () => {
      this.pause.setAttribute('aria-pressed', String(!this.paused))
      void this.apply()
    })
    this.undo = app.store.on('state', (state) => {
      this.node.hidden = !state.replay
      if (state.replay) this.follow(state.replay)
    })
  }

  private get paused(): boolean {
    return this.pause.getAttribute('aria-pressed') === 'true'
  }

  async open(recording: RecordingInfo): Promise<void> {
    await this.app.attempt(api.replay(recording.name, Number(this.speed.value), 0))
  }

  private follow(replay: ReplayProgress): void {
    this.name = replay.name
    if (this.seeking) return
    this.slider.min = String(replay.start_s)
    this.slider.max = String(replay.end_s)
    this.slider.value = String(replay.t_s)
    this.time.textContent = `${duration(replay.t_s - replay.start_s)} / ${duration(replay.end_s - replay.start_s)}`
  }

  private async apply(): Promise<void> {
    const speed = this.paused ? 0 : Number(this.speed.value)
    if (this.name) await this.app.attempt(api.replay(this.name, speed, Number(this.slider.value)))
    this.seeking = false
  }

  close(): void {
    this.undo()
  }
}
