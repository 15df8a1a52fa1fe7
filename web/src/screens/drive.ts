/** Drive: where the robot is, what it sees, and the mission's buttons. */

import type { App, Screen } from '../app.ts'
import { CameraPicture } from '../camera/picture.ts'
import { el, setText } from '../dom.ts'
import { duration, fixed, glue, metres, NONE } from '../format.ts'
import { compassText } from '../geo.ts'
import { mapControls } from '../map/controls.ts'
import { openMap } from '../map/shared.ts'
import type { ImplementLine } from '../wire.ts'
import { GateCard, GateLine } from './gate-card.ts'
import { HeadingCard } from './heading-card.ts'
import { MissionButtons } from './mission-buttons.ts'

const TEXT_EVERY_MS = 200

export const drive: Screen = {
  id: 'drive',
  title: 'Drive',
  icon: 'drive',
  async mount(host, app) {
    const mapHost = el('div', { class: 'map-host card' })
    const buttons = new MissionButtons(app)
    const facts = new Facts(app)
    const gate = new GateCard(app)
    const heading = new HeadingCard(app)
    const camera = cameraCard(app)
    host.append(
      mapHost,
      el(
        'div',
        { class: 'side' },
        el('div', { class: 'card mission' }, progress(app, facts), buttons.node),
        heading.node,
        gate.node,
        camera.node,
        facts.node,
      ),
    )
    const timer = setInterval(() => {
      facts.update()
      buttons.update()
      heading.update()
      gate.update()
      camera.update()
    }, TEXT_EVERY_MS)
    const view = await openMap(mapHost, app)
    const controls = view && mapControls(view, app)
    if (controls) mapHost.append(controls.node)
    return () => {
      clearInterval(timer)
      camera.close()
      controls?.done()
    }
  },
}

function cameraCard(app: App): { node: HTMLElement; update: () => void; close: () => void } {
  if (!app.session.camera || app.off.has('camera')) {
    return {
      node: el('div', { class: 'card empty' }, 'This robot has no camera.'),
      update: () => undefined,
      close: () => undefined,
    }
  }
  const picture = new CameraPicture(app.store)
  const label = el('span', { class: 'picture-label' })
  const node = el(
    'div',
    { class: 'card camera-card' },
    el('a', { href: '#/camera', 'aria-label': 'Open the camera large' }, picture.node),
    label,
  )
  return { node, update: () => setText(label, picture.label(performance.now())), close: () => picture.close() }
}

function progress(app: App, facts: Facts): HTMLElement {
  const bar = el('progress', { max: 1, value: 0, 'aria-label': 'Mission progress' })
  const text = el('span', { class: 'progress-text' })
  const gate = new GateLine()
  facts.also(() => {
    const mission = app.store.state?.mission
    const share = mission && mission.length_m > 0 ? Math.min(1, mission.s_m / mission.length_m) : 0
    bar.value = share
    setText(text, mission ? `${(share * 100).toFixed(0)} %` : NONE)
    gate.update(app.store.state)
  })
  return el(
    'div',
    { class: 'progress' },
    el('div', { class: 'card-head' }, el('h2', {}, 'Mission'), gate.head),
    el('div', { class: 'progress-line' }, bar, text),
    gate.reason,
  )
}

/** The figures beside the map. */
class Facts {
  readonly node = el('dl', { class: 'facts card' })
  private readonly rows: [HTMLElement, () => string][] = []
  private readonly others: (() => void)[] = []

  constructor(private readonly app: App) {
    const state = () => app.store.state
    const mission = () => state()?.mission
    this.row('Speed', () => fixed(state()?.v_mps, 2, 'm/s'))
    this.row('Heading', () => {
      const pose = state()?.pose
      return pose ? compassText(pose[2]) : NONE
    })
    this.row('Row', () => this.rowText())
    this.row('Goals', () => this.goalText())
    this.row('Distance', () =>
      mission() ? `${glue(metres(mission()?.s_m))} of ${glue(metres(mission()?.length_m))}` : NONE,
    )
    this.row('Time left', () => duration(mission()?.eta_s))
    this.row('Off the path', () => metres(absolute(state()?.cross_track_m)))
    this.row('Position ±', () => metres(state()?.pos_std_m))
    this.row('Weeds', () => String(state()?.weed_count ?? app.store.weeds.size))
    this.row('Implement', () => implementText(state()?.implement), 'implement')
  }

  private row(name: string, text: () => string, kind = ''): void {
    const value = el('dd', { class: kind }, NONE)
    this.node.append(el('div', {}, el('dt', {}, name), value))
    this.rows.push([value, text])
  }

  private rowText(): string {
    const mission = this.app.store.state?.mission
    if (!mission?.rows_total) return NONE
    const here = mission.row === null || mission.row < 0 ? NONE : String(mission.row + 1)
    return `${here} of ${mission.rows_total} (${mission.rows_done} done)`
  }

  private goalText(): string {
    const mission = this.app.store.state?.mission
    return mission?.waypoints_total ? `${mission.waypoints_reached} of ${mission.waypoints_total}` : NONE
  }

  also(work: () => void): void {
    this.others.push(work)
  }

  update(): void {
    for (const [node, text] of this.rows) setText(node, text())
    for (const work of this.others) work()
  }
}

function absolute(value: number | null | undefined): number | null {
  return value === null || value === undefined ? null : Math.abs(value)
}

/** What the implement does, in its own words. */
function implementText(lines: ImplementLine[] | undefined): string {
  return lines?.map(({ name, text }) => `${name} ${text}`).join(', ') || NONE
}
