/** Who publishes and who listens: inside the robot with measured rates, and in its networks. */

import { api, message } from '../api.ts'
import { el, replace } from '../dom.ts'
import { say } from '../say.ts'

const REFRESH_MS = 2000
const NETWORKS: [id: string, title: string][] = [
  ['robot', say('insideTheRobot')],
  ['ros1', 'ROS 1'],
  ['ros2', 'ROS 2'],
  ['dds', say('rosOnDds')],
]

export class GraphCard {
  readonly node: HTMLElement
  private readonly picture = el('div', {
    class: 'graph-scroll',
    tabindex: 0,
    role: 'group',
    'aria-label': say('graph'),
  })
  private readonly network = el(
    'select',
    { 'aria-label': say('network'), onchange: () => void this.refresh() },
    ...NETWORKS.map(([value, title]) => el('option', { value }, title)),
  )
  private readonly details: HTMLDetailsElement
  private readonly timer: number

  constructor() {
    this.details = el(
      'details',
      { ontoggle: () => void this.refresh() },
      el('summary', {}, say('nodesAndTopics')),
      el('div', { class: 'graph-head' }, this.network),
      this.picture,
    )
    this.node = el('div', { class: 'card graph-card' }, this.details)
    this.timer = window.setInterval(() => void this.refresh(), REFRESH_MS)
  }

  close(): void {
    clearInterval(this.timer)
  }

  private async refresh(): Promise<void> {
    if (!this.details.open || document.hidden) return
    const asked = this.network.value
    try {
      const text = await api.graphPicture(asked)
      if (asked !== this.network.value) return
      const found = new DOMParser().parseFromString(text, 'image/svg+xml').documentElement
      replace(this.picture, document.adoptNode(found))
    } catch (error) {
      replace(this.picture, el('p', { class: 'muted' }, message(error)))
    }
  }
}
