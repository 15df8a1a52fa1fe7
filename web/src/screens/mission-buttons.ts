/** Start, pause, resume, skip or shift a row, return home, cancel: shown to the operator where the mode allows them. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import type { IconName } from '../icons.ts'
import { icon } from '../icons.ts'
import { seatButton } from '../shell/seat.ts'
import type { MissionAction, Mode } from '../wire.ts'
import { say } from '../say.ts'

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
  { action: 'start', label: say('startAgain'), icon: 'play', in: ['done'], kind: 'primary', ask: true },
  { action: 'pause', label: say('pause'), icon: 'pause', in: ['mission'], kind: 'primary' },
  { action: 'resume', label: say('resume'), icon: 'play', in: ['paused', 'teleop', 'waiting'], kind: 'primary' },
  { action: 'skip_row', label: say('skipRow'), icon: 'skip', in: ['mission', 'paused'] },
  { action: 'nudge_left', label: say('row1CmLeft'), icon: 'left', in: ['mission', 'paused'], inRow: true },
  { action: 'nudge_right', label: say('row1CmRight'), icon: 'right', in: ['mission', 'paused'], inRow: true },
  {
    action: 'return_home',
    label: say('returnHome'),
    icon: 'home',
    in: ['mission', 'paused', 'done', 'waiting'],
    ask: true,
  },
  { action: 'cancel', label: say('endMission'), icon: 'cancel', in: ['mission', 'paused'], kind: 'danger', ask: true },
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
    const again = count ? say('startAgainRows', { count }) : say('startAgainBody')
    const body =
      action.action === 'cancel'
        ? say('endMissionBody')
        : action.action === 'return_home'
          ? say('returnHomeBody')
          : state?.recording
            ? again
            : `${again} ${say('startAgainRecording')}`
    const title = say('askWhether', { action: action.label })
    return this.app.dialogs.confirm(title, [body], action.label, action.kind ?? 'primary')
  }
}
