/** Start, pause, resume, skip or shift a row, return home, cancel: shown to the operator where the mode allows them. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import { seatButton } from '../shell/seat.ts'
import type { MissionAction, Mode } from '../wire.ts'

interface Action {
  action: MissionAction
  label: string
  icon: IconName
  in: Mode[]
  kind?: 'primary' | 'danger'
  ask?: boolean
  /** Only while the robot is in a row. */
  inRow?: boolean
}

const ACTIONS: Action[] = [
  { action: 'start', label: 'Start again', icon: 'play', in: ['done'], kind: 'primary', ask: true },
  { action: 'pause', label: 'Pause', icon: 'pause', in: ['mission'], kind: 'primary' },
  { action: 'resume', label: 'Resume', icon: 'play', in: ['paused', 'teleop'], kind: 'primary' },
  { action: 'skip_row', label: 'Skip row', icon: 'skip', in: ['mission', 'paused'] },
  { action: 'nudge_left', label: 'Row 1 cm left', icon: 'left', in: ['mission', 'paused'], inRow: true },
  { action: 'nudge_right', label: 'Row 1 cm right', icon: 'right', in: ['mission', 'paused'], inRow: true },
  {
    action: 'return_home',
    label: 'Return home',
    icon: 'home',
    in: ['mission', 'paused', 'done', 'waiting'],
    ask: true,
  },
  { action: 'cancel', label: 'End mission', icon: 'cancel', in: ['mission', 'paused'], kind: 'danger', ask: true },
]

export class MissionButtons {
  readonly node: HTMLElement
  private readonly buttons: [Action, HTMLButtonElement][]
  private readonly row = el('div', { class: 'button-row' })

  constructor(private readonly app: App) {
    this.buttons = ACTIONS.map((action) => [
      action,
      el(
        'button',
        {
          type: 'button',
          class: `button ${action.kind ?? ''}`,
          'data-action': action.action,
          onclick: () => void this.run(action),
        },
        icon(action.icon, 20),
        action.label,
      ),
    ])
    this.row.append(...this.buttons.map(([, button]) => button))
    this.node = el('div', { class: 'mission-buttons' }, seatButton(app).node, this.row)
    this.update()
  }

  update(): void {
    const mode = this.app.store.state?.mode
    const mine = this.app.mayCommand
    const isInRow = (this.app.store.state?.mission?.row ?? -1) >= 0
    for (const [action, button] of this.buttons) {
      button.hidden = !mine || !mode || !action.in.includes(mode) || (action.inRow === true && !isInRow)
    }
  }

  private async run(action: Action): Promise<void> {
    if (action.ask && !(await this.confirmed(action))) return
    await this.app.command({ kind: 'control_mission', action: action.action })
  }

  private confirmed(action: Action): Promise<boolean> {
    const state = this.app.store.state
    const count = state?.mission?.rows_total ?? 0
    const rows = count ? `: ${count} ${count === 1 ? 'row' : 'rows'}` : ''
    const unrecorded = state?.recording ? '' : ' A recording of its own begins with it where runs are recorded.'
    const body =
      action.action === 'cancel'
        ? 'The robot stops where it is and the mission ends. The recording is kept.'
        : action.action === 'return_home'
          ? 'The robot leaves its mission and drives back to where it started.'
          : `The robot does its whole mission once more, from where it stands${rows}. ` +
            `Make sure nobody is in its way.${unrecorded}`
    return this.app.dialogs.confirm(`${action.label}?`, [body], action.label, action.kind ?? 'primary')
  }
}
