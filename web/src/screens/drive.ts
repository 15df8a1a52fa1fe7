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
import { decimals, named, say } from '../say.ts'

const TEXT_EVERY_MS = 200

export const drive: Screen = {
  id: 'drive',
  title: say('screenDrive'),
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
      node: el('div', { class: 'card empty' }, say('noCamera')),
      update: () => undefined,
      close: () => undefined,
    }
  }
  const picture = new CameraPicture(app.store)
  const label = el('span', { class: 'picture-label' })
  const node = el(
    'div',
    { class: 'card camera-card' },
    el('a', { href: '#/camera', 'aria-label': say('openTheCameraLarge') }, picture.node),
    label,
  )
  return { node, update: () => setText(label, picture.label(performance.now())), close: () => picture.close() }
}

function progress(app: App, facts: Facts): HTMLElement {
  const bar = el('progress', { max: 1, value: 0, 'aria-label': say('missionProgress') })
  const text = el('span', { class: 'progress-text' })
  const gate = new GateLine()
  facts.also(() => {
    const mission = app.store.state?.mission
    const share = mission && mission.length_m > 0 ? Math.min(1, mission.s_m / mission.length_m) : 0
    bar.value = share
    setText(text, mission ? `${decimals(share * 100, 0)} %` : NONE)
    gate.update(app.store.state)
  })
  return el(
    'div',
    { class: 'progress' },
    el('div', { class: 'card-head' }, el('h2', {}, say('mission')), gate.head),
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
    this.row(say('speed'), () => fixed(state()?.v_mps, 2, 'm/s'))
    this.row(say('heading'), () => {
      const pose = state()?.pose
      return pose ? compassText(pose[2]) : NONE
    })
    this.row(say('row'), () => this.rowText())
    this.row(say('goals'), () => this.goalText())
    this.row(say('distance'), () => this.distanceText())
    this.row(say('timeLeft'), () => duration(mission()?.eta_s))
    this.row(say('offThePath'), () => metres(absolute(state()?.cross_track_m)))
    this.row(say('position'), () => metres(state()?.pos_std_m))
    this.row(say('weeds'), () => String(state()?.weed_count ?? app.store.weeds.size))
    this.row(say('implement'), () => implementText(state()?.implement), 'implement')
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
    return say('rowProgress', { row: here, total: mission.rows_total, done: mission.rows_done })
  }

  private goalText(): string {
    const mission = this.app.store.state?.mission
    if (!mission?.waypoints_total) return NONE
    return say('someOfAll', { some: mission.waypoints_reached, all: mission.waypoints_total })
  }

  private distanceText(): string {
    const mission = this.app.store.state?.mission
    return mission ? say('someOfAll', { some: glue(metres(mission.s_m)), all: glue(metres(mission.length_m)) }) : NONE
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
  return lines?.map(({ name, text }) => `${named(name)} ${named(text)}`).join(', ') || NONE
}
