/** What must not be missed: a line that is slow or lost, old data, a pressed STOP, a replay. */

import { el, setText } from '../dom.ts'
import { uncapitalised } from '../format.ts'
import { icon } from '../icons.ts'
import type { IconName } from '../icons.ts'
import type { Link } from '../link.ts'
import type { Store } from '../store.ts'
import { seconds, tellLine } from './line-text.ts'
import { MODE_NAMES } from './statusbar.ts'
import { say } from '../say.ts'

const UPDATE_MS = 100
const CONFIRMED_WITHIN_MS = 1000

class Banner {
  readonly node: HTMLElement
  private readonly text = el('span')

  constructor(name: IconName, kind: 'bad' | 'note', ...more: HTMLElement[]) {
    this.node = el(
      'div',
      { class: `banner ${kind}`, hidden: true, ...(kind === 'bad' ? { role: 'alert' } : {}) },
      icon(name, 20),
      this.text,
      ...more,
    )
  }

  /** Hidden without words. */
  show(words: string): void {
    this.node.hidden = !words
    if (words) setText(this.text, words)
  }
}

export class Banners {
  /** Null until the page may command. */
  onRelease: (() => void) | null = null
  readonly node: HTMLElement
  private readonly line = new Banner('warning', 'bad')
  private readonly unconfirmed = new Banner('stop', 'bad')
  private readonly release = el('button', { type: 'button', class: 'button' }, say('releaseStop'))
  private readonly stopped = new Banner('stop', 'bad', this.release)
  private readonly replay = new Banner(
    'recordings',
    'note',
    el('a', { href: '#/recordings', class: 'button' }, say('recordings')),
  )

  constructor(
    private readonly store: Store,
    private readonly link: Link,
    private readonly main: HTMLElement,
  ) {
    this.node = el(
      'div',
      { class: 'banners' },
      this.line.node,
      this.unconfirmed.node,
      this.stopped.node,
      this.replay.node,
    )
    this.main.dataset.replay = say('replayMark')
    this.release.addEventListener('click', () => this.onRelease?.())
    new ResizeObserver(() => this.tellHeight()).observe(this.node)
    setInterval(() => this.update(), UPDATE_MS)
    store.on('stale', () => this.update())
    store.on('link', () => this.update())
  }

  /** What lies below may keep out of the way. */
  private tellHeight(): void {
    this.node.parentElement?.style.setProperty('--banners', `${this.node.offsetHeight}px`)
  }

  private update(): void {
    const { store } = this
    const isReplay = store.channel?.source === 'replay'
    this.main.classList.toggle('is-stale', store.stale)
    this.main.classList.toggle('is-replay', isReplay)
    this.line.show(this.lineText())
    this.unconfirmed.show(this.unconfirmedText())
    const stop = isReplay ? store.live?.stop : store.state?.stop
    this.stopped.show(stop ? say(isReplay ? 'robotItselfIsHeld' : 'stoppedFor', { reason: stop }) : '')
    this.release.hidden = store.seat !== 'you' || isReplay || !this.onRelease
    this.replay.show(isReplay ? this.replayText() : '')
  }

  private lineText(): string {
    return this.link.isResting ? '' : tellLine(this.store, performance.now(), this.link.farewell)
  }

  private unconfirmedText(): string {
    const waitedMs = this.store.stop.waitedMs(performance.now())
    if (waitedMs < CONFIRMED_WITHIN_MS) return ''
    return say('stopNotConfirmed', { time: seconds(waitedMs) })
  }

  private replayText(): string {
    const { channel, live, hasRobot } = this.store
    const banner = say(hasRobot ? 'replayBannerWithStop' : 'replayBanner', { name: channel?.name ?? '' })
    return live ? `${banner} ${say('robotItself', { mode: uncapitalised(MODE_NAMES[live.mode]) })}` : banner
  }
}
