/** A place shown with a finger that the robot is to go to, or stands at: nothing is sent before it is confirmed. */

import { api, ApiError, message } from '../api.ts'
import type { App } from '../app.ts'
import { el, setText } from '../dom.ts'
import { duration, metres } from '../format.ts'
import { compassText, distanceM } from '../geo.ts'
import type { GoalPreview, PageRequest, State, Vec2 } from '../wire.ts'
import { say } from '../say.ts'

/** The way to a goal before it is sent; without numbers where the robot was not asked. */
type Way = GoalPreview | { points_map_m: []; length_m: null; time_s: null }

export interface Proposal {
  what: 'goal' | 'pose'
  at: Vec2
  yaw: number | null
  way: Way | null
  problem: string
  /** Where the robot was when its way was asked for. */
  from: Vec2 | null
  isAsking: boolean
}

/** The path of another page's goal comes a little later than the word that the robot follows it. */
const PATH_WITHIN_S = 0.5
/** Distance after which the robot is asked for its way again, m. */
const WAY_LASTS_M = 1
/** Between a message and what is proposed, the edge of the map included. */
const GAP_PX = 24
const GOAL_LEGS = new Set(['stops first', 'to the goal'])
const BAD_GOAL = new Set([400, 409, 422])

export class Proposals {
  now: Proposal | null = null
  /** The goal that this page sent, until the robot has been there or somewhere else. */
  private sent: Vec2 | null = null
  private leg: string | undefined
  private legSinceS = -Infinity
  /** Something to draw has changed. */
  onChange: () => void = () => undefined
  /** It was confirmed or dropped. */
  onEnd: () => void = () => undefined
  readonly card = new Card(
    () => void this.confirm(),
    () => this.end(),
  )

  constructor(private readonly app: App) {
    app.store.on('seat', () => this.show())
    app.store.on('restart', () => this.drop())
    app.store.on('state', (state) => this.follow(state))
  }

  /** Where the robot is driving to on demand, as far as anybody knows. */
  get goal(): Vec2 | null {
    const { state, path } = this.app.store
    const { leg, state: doing } = state?.mission ?? {}
    if (leg === 'stops first') return this.sent
    if (leg !== 'to the goal' || doing !== 'running' || !state) return null
    const isPathKnown = state.t_s - this.legSinceS > PATH_WITHIN_S
    return this.sent ?? (isPathKnown ? (path?.points_map_m.at(-1) ?? null) : null)
  }

  private follow({ t_s, mission, pose }: State): void {
    if (pose) this.askAgain([pose[0], pose[1]])
    const leg = mission?.leg
    if (leg === this.leg) return
    if (GOAL_LEGS.has(this.leg ?? '') && !GOAL_LEGS.has(leg ?? '')) this.sent = null
    if (this.leg !== undefined) this.legSinceS = t_s
    this.leg = leg
  }

  propose(what: Proposal['what'], at: Vec2, yaw: number | null): void {
    const proposal: Proposal = { what, at, yaw, way: null, problem: '', from: null, isAsking: false }
    this.now = proposal
    this.show()
    if (what === 'goal') void this.ask(proposal)
  }

  drop(): void {
    this.now = null
    this.show()
  }

  private end(): void {
    this.drop()
    this.onEnd()
  }

  /** The robot may drive on while somebody thinks. */
  private askAgain(here: Vec2): void {
    const proposal = this.now
    if (proposal?.what !== 'goal' || proposal.isAsking) return
    if (!proposal.from || distanceM(proposal.from, here) > WAY_LASTS_M) void this.ask(proposal)
  }

  private async ask(proposal: Proposal): Promise<void> {
    const [x, y] = proposal.at
    const pose = this.app.store.state?.pose
    proposal.from = pose ? [pose[0], pose[1]] : null
    proposal.isAsking = true
    try {
      proposal.way = await api.previewGoal({ x_map_m: x, y_map_m: y, yaw_map_rad: proposal.yaw })
      proposal.problem = ''
    } catch (error) {
      const isBad = error instanceof ApiError && BAD_GOAL.has(error.status)
      proposal.way = { points_map_m: [], length_m: null, time_s: null }
      proposal.problem = isBad ? message(error) : ''
    }
    proposal.isAsking = false
    if (proposal === this.now) this.show()
  }

  private async confirm(): Promise<void> {
    const proposal = this.now
    if (!proposal) return
    const {
      what,
      at: [x, y],
      yaw,
    } = proposal
    const place = { x_map_m: x, y_map_m: y, yaw_map_rad: yaw ?? 0 }
    const command: PageRequest =
      what === 'goal' ? { kind: 'go_to', ...place, yaw_map_rad: yaw } : { kind: 'correct_pose', ...place }
    if (what === 'goal') this.sent = [x, y]
    this.end()
    const isTaken = await this.app.command(command, what === 'goal' ? say('drivesToPlace') : say('poseCorrected'))
    if (!isTaken) this.sent = null
  }

  private show(): void {
    this.card.show(this.now && this.text(this.now), this.app.mayCommand && !this.now?.problem)
    this.onChange()
  }

  private text(proposal: Proposal): CardText {
    const { what, at, yaw, way, problem } = proposal
    const { state, seat } = this.app.store
    const noSeat = seat === 'you' ? '' : say('onlyOperatorMaySend')
    if (what === 'pose')
      return {
        title: say('standsHere'),
        about: yaw === null ? say('atThisPlace') : say('atThisPlaceLooking', { heading: compassText(yaw) }),
        problem: noSeat,
        yes: say('correctThePose'),
      }
    const straight = state?.pose
      ? say('straightAway', { distance: metres(distanceM([state.pose[0], state.pose[1]], at)) })
      : say('placeUnknown')
    const about =
      way === null
        ? say('askingForWay')
        : way.length_m === null
          ? sentenceOf(straight, yaw)
          : sentenceOf(say('wayThere', { length: metres(way.length_m), time: wait(way.time_s) }), yaw)
    const leaves = state?.mode === 'mission' ? ` ${say('leavesMission')}` : ''
    return {
      title: say('askDriveHere'),
      about: problem ? '' : about + leaves,
      problem: problem || noSeat,
      yes: say('driveHere'),
    }
  }
}

function sentenceOf(way: string, yaw: number | null): string {
  return yaw === null ? say('goalText', { way }) : say('goalTextLooking', { way, heading: compassText(yaw) })
}

function wait(seconds: number | null): string {
  return seconds !== null && seconds < 60 ? `${Math.ceil(seconds)} s` : `${duration(seconds)} min`
}

interface CardText {
  title: string
  about: string
  problem: string
  yes: string
}

class Card {
  private readonly title = el('strong')
  private readonly about = el('p')
  private readonly problem = el('p', { class: 'problem' })
  private readonly yes: HTMLButtonElement
  readonly node: HTMLElement

  constructor(confirm: () => void, cancel: () => void) {
    this.yes = el('button', { type: 'button', class: 'button primary', onclick: confirm })
    this.node = el(
      'div',
      { class: 'map-proposal card', role: 'group', 'aria-label': say('proposal'), hidden: true },
      el('div', { class: 'proposal-text', role: 'status' }, this.title, this.about, this.problem),
      el(
        'div',
        { class: 'button-row' },
        el('button', { type: 'button', class: 'button', onclick: cancel }, say('cancel')),
        this.yes,
      ),
    )
    this.node.addEventListener('keydown', (event) => {
      if (event.key === 'Escape') cancel()
    })
    new ResizeObserver(() => this.tellHeight()).observe(this.node)
  }

  /** Messages keep above it; nothing of its height is left where it is hidden or its screen was left. */
  private tellHeight(): void {
    const { offsetHeight } = this.node
    document.documentElement.style.setProperty('--proposal', `${offsetHeight && offsetHeight + GAP_PX}px`)
  }

  show(text: CardText | null, maySend: boolean): void {
    this.node.hidden = text === null
    if (!text) return
    setText(this.title, text.title)
    setText(this.about, text.about)
    setText(this.problem, text.problem)
    setText(this.yes, text.yes)
    this.yes.disabled = !maySend
  }
}
