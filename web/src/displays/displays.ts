/** All displays of the map: those of the robot's maps and programs, and those the operator added. */

import { api } from '../api.ts'
import type { MapSource, PanelInfo, TopicNetworkInfo } from '../wire.ts'
import { Display } from './display.ts'
import type { DisplayConfig } from './display.ts'
import type { DisplayHost } from './host.ts'
import type { Surface } from './instruments.ts'
import type { Options, OptionValue } from './options.ts'
import { panelSource, robotSources, tileSource } from './sources.ts'
import type { Source } from './sources.ts'
import { TopicPoller, topicSource, topicSources } from './topics.ts'
import type { DisplayType } from './types.ts'
import { typeOf } from './types.ts'

const PANELS_EVERY_MS = 5000

export class Displays {
  readonly all: Display[] = []
  private maps: MapSource[] = []
  private panels: PanelInfo[] = []
  private networks: TopicNetworkInfo[] = []
  private readonly topics = new TopicPoller(() => this.isShown)
  private made = 0
  /** True once the robot's own are there; before, nothing may be remembered of them. */
  started = false

  constructor(private readonly host: DisplayHost) {}

  /** The robot's maps and the layers of programs; programs may add some later. */
  async start(): Promise<void> {
    this.host.app.store.on('restart', () => this.restart())
    this.maps = await api.maps().catch((): MapSource[] => [])
    for (const { name } of this.maps)
      this.add({ id: `tiles-${name}`, type: 'tile_map', title: name, source: name, options: {} }, false)
    await this.syncPanels()
    this.started = true
    setInterval(() => {
      if (this.isShown) void this.syncPanels()
    }, PANELS_EVERY_MS)
  }

  /** What the robot said of another channel; what programs give is theirs. */
  private restart(): void {
    const own = new Set(robotSources(this.host.app).map(({ id }) => id))
    for (const display of this.all) if (own.has(display.config.source)) display.restart()
  }

  private get isShown(): boolean {
    return this.host.node.isConnected && !document.hidden
  }

  private async syncPanels(): Promise<void> {
    const found = await api.panels().catch(() => null)
    if (!found) return
    for (const panel of this.panels) if (!found.some(({ id }) => id === panel.id)) this.dropPanel(panel.id)
    const before = new Map(this.panels.map((panel) => [panel.id, JSON.stringify(panel)]))
    this.panels = found
    for (const panel of found)
      if (panel.kind === 'layer' && before.get(panel.id) !== JSON.stringify(panel)) this.showPanel(panel)
  }

  private dropPanel(id: string): void {
    const known = this.all.find((display) => display.id === id)
    if (known) this.remove(known)
  }

  private showPanel(panel: PanelInfo): void {
    this.dropPanel(panel.id)
    const display = this.add(
      {
        id: panel.id,
        type: panel.type ?? 'geojson',
        title: panel.title,
        source: panel.topic ?? panel.id,
        options: (panel.style ?? {}) as Options,
      },
      false,
    )
    if (!display || (panel.visible === undefined && panel.draw_order === undefined)) return
    display.visible = panel.visible ?? true
    const order = panel.draw_order
    if (order !== undefined) this.host.moveGroup(display, order < 0 ? this.host.groups.length + order : order)
    this.host.applyGroup(display)
  }

  /** Everything that a type could show now. */
  sources(type: DisplayType): Source[] {
    if (type.kind === 'tiles') return this.maps.map((tiles) => tileSource(tiles, type.id))
    const given = this.panels
      .filter((panel) => panel.kind === 'layer' || panel.kind === 'image')
      .map((panel) => panelSource(panel, () => this.isShown))
    const here = [...robotSources(this.host.app), ...given].filter((source) => source.types.includes(type.id))
    return [...here, ...topicSources(this.topics, this.networks, type.id)]
  }

  /** Ask the robot which topics there are; what came of it, by network. */
  async findTopics(): Promise<TopicNetworkInfo[]> {
    this.networks = await api.topics().catch((): TopicNetworkInfo[] => [])
    return this.networks
  }

  /** Null where the type is unknown, or is a tool. */
  add(config: DisplayConfig, removable = true): Display | null {
    const type = typeOf(config.type)
    if (!type || type.kind === 'tool' || this.all.some(({ id }) => id === config.id)) return null
    const source =
      this.sources(type).find(({ id }) => id === config.source) ??
      topicSource(this.topics, config.source, config.source, [type.id]) // which need not be there yet
    const display = new Display(this.host, type, source, config, removable)
    this.all.push(display)
    this.host.addGroup(display)
    return display
  }

  /** A display that the operator asked for. */
  make(type: string, title: string, source: string, options: Record<string, OptionValue>): Display | null {
    const taken = new Set(this.all.map(({ id }) => id))
    do this.made++
    while (taken.has(`display-${this.made}`))
    return this.add({ id: `display-${this.made}`, type, title, source, options })
  }

  remove(display: Display): void {
    this.all.splice(this.all.indexOf(display), 1)
    display.remove()
    this.host.removeGroup(display)
    this.host.onConditions()
  }

  paint(surface: Surface): void {
    for (const display of [...this.all].sort((a, b) => this.host.groups.indexOf(b) - this.host.groups.indexOf(a)))
      display.paint(surface)
  }

  saved(): DisplayConfig[] {
    return this.all.filter((display) => display.removable).map((display) => display.saved())
  }

  /** Exactly the operator's displays of a saved view. */
  restore(configs: DisplayConfig[]): void {
    for (const display of [...this.all])
      if (display.removable && !configs.some(({ id }) => id === display.id)) this.remove(display)
    for (const config of configs) {
      const known = this.all.find(({ id }) => id === config.id)
      if (known) known.setOptions(config.options)
      else this.add(config)
    }
  }
}
