/** Topics of ROS and of recordings that displays look at: one question for all of them, again and again. */

import { api } from '../api.ts'
import type { TopicNews, TopicNetworkInfo, TopicWish } from '../wire.ts'
import type { Listener, Source, Tell } from './sources.ts'
import { say } from '../say.ts'

const EVERY_MS = 200
const AFTER_FAILURE_MS = 2000
const SEPARATOR = ':'

interface Watcher {
  wish: TopicWish
  hear: Listener
  tell: Tell
}

/** `ros1:/scan`; a bag's name may hold what separates, a topic's begins with a slash or is a frame. */
export function topicId(source: string, name: string): string {
  return `${source}${SEPARATOR}${name}`
}

/** Source and name of a topic's id; null for the id of anything else. */
export function readTopicId(id: string): { source: string; name: string } | null {
  const found = /^(ros1|ros2|dds|recording|bag:.+?):(\/.*|frame:.+)$/.exec(id)
  return found && { source: found[1], name: found[2] }
}

export class TopicPoller {
  private readonly watchers = new Set<Watcher>()
  private timer = 0
  private isAsking = false

  constructor(private readonly isShown: () => boolean) {}

  /** Hear a topic until the function that this gives is called. */
  watch(source: string, name: string, hear: Listener, tell: Tell): () => void {
    const watcher = { wish: { source, name, after: 0 }, hear, tell }
    this.watchers.add(watcher)
    this.schedule(0)
    return () => this.watchers.delete(watcher)
  }

  private schedule(ms: number): void {
    if (this.isAsking || !this.watchers.size) return
    clearTimeout(this.timer)
    this.timer = window.setTimeout(() => void this.ask(), ms)
  }

  private async ask(): Promise<void> {
    const watchers = [...this.watchers]
    let next = EVERY_MS
    if (this.isShown() && watchers.length) {
      this.isAsking = true
      const news = await api.readTopics(watchers.map(({ wish }) => wish)).catch(() => null)
      this.isAsking = false
      if (news) watchers.forEach((watcher, i) => this.take(watcher, news[i]))
      else {
        next = AFTER_FAILURE_MS
        for (const { tell } of watchers) tell({ note: say('doesNotAnswer'), leftOut: '', isStale: true })
      }
    }
    this.schedule(next)
  }

  private take(watcher: Watcher, news: TopicNews | undefined): void {
    if (!news || !this.watchers.has(watcher)) return
    watcher.tell({ note: news.note, leftOut: news.left_out, isStale: news.is_stale })
    if (news.message === null) return
    watcher.wish = { ...watcher.wish, after: news.seq }
    watcher.hear(news.message)
  }
}

export function topicSource(poller: TopicPoller, id: string, title: string, types: string[]): Source | null {
  const topic = readTopicId(id)
  return (
    topic && {
      id,
      title,
      types,
      listen: (hear, tell) => poller.watch(topic.source, topic.name, hear, tell),
    }
  )
}

export function titleOf(name: string): string {
  return name.replace(/^frame:/, `${say('kindFrame')} `)
}

/** The topics that one kind of display can show, as sources with their network in the title. */
export function topicSources(poller: TopicPoller, networks: TopicNetworkInfo[], type: string): Source[] {
  return networks.flatMap(({ source, title, topics }) =>
    topics
      .filter(({ displays }) => displays.includes(type))
      .flatMap(({ name }) => {
        const found = topicSource(poller, topicId(source, name), titleOf(name), [type])
        return found ? [{ ...found, network: title }] : []
      }),
  )
}
