/** One display on the map: hears its source, remembers what its type wants, and draws it. */

import type { GeoJSONSource, ImageSource } from 'maplibre-gl'
import { collection, EMPTY, SOURCE_MAXZOOM } from '../geojson.ts'
import type { Features } from '../geojson.ts'
import type { MapSource } from '../wire.ts'
import { Drawing } from './drawing.ts'
import type { DisplayHost, LayerGroup } from './host.ts'
import { FADED } from './host.ts'
import type { Surface } from './instruments.ts'
import type { Options } from './options.ts'
import { filled } from './options.ts'
import { lookLayers } from './look-layers.ts'
import type { Condition, Source } from './sources.ts'
import type { Setting } from './setting.ts'
import type { DisplayType } from './types.ts'

const REDRAW_MS = 100

/** What a saved view keeps of a display. */
export interface DisplayConfig {
  id: string
  type: string
  title: string
  source: string
  options: Options
}

export class Display implements LayerGroup {
  readonly id: string
  title: string
  layers: string[] = []
  visible = true
  opacity = 1
  options: Options
  /** What is wrong with its source, and what was left out. */
  condition: Condition = { note: '', leftOut: '', isStale: false }
  /** Messages heard, for tests. */
  heard = 0
  private state: unknown
  private stretch = 0
  private last: unknown
  private drawn = ''
  private timer = 0
  private unsubscribe: () => void = () => undefined

  constructor(
    private readonly host: DisplayHost,
    readonly type: DisplayType,
    source: Source | null,
    readonly config: DisplayConfig,
    /** Added by the operator, who may remove it; the others come from the robot. */
    readonly removable: boolean,
  ) {
    this.id = config.id
    this.title = config.title
    this.options = filled(type.options, config.options)
    this.addLayers(source)
    this.unsubscribe =
      source?.listen(
        (message) => void this.hear(message),
        (condition) => this.tell(condition),
      ) ?? this.unsubscribe
    if (!source) this.draw()
  }

  /** Forget what was heard: something else is shown from now on. */
  restart(): void {
    this.stretch++
    this.state = this.last = undefined
    this.queue()
  }

  saved(): DisplayConfig {
    return { id: this.id, type: this.type.id, title: this.title, source: this.config.source, options: this.options }
  }

  setOptions(options: Options): void {
    this.options = filled(this.type.options, options)
    if (this.last === undefined) this.queue()
    else void this.hear(this.last)
  }

  /** Painted over the map with each frame; nothing for those that are part of it. */
  paint(surface: Surface): void {
    if (this.type.kind !== 'painted' || !this.visible || this.state === undefined) return
    surface.pen.save()
    surface.pen.globalAlpha = this.opacity * (this.isFaded ? FADED : 1)
    this.type.paint(this.state as never, surface, this.setting)
    surface.pen.restore()
  }

  retheme(): void {
    if (this.type.kind !== 'shapes') return
    for (const layer of lookLayers(this.id, this.host.app.projection.latDeg))
      if (layer.type === 'symbol') this.host.map.setLayoutProperty(layer.id, 'icon-image', layer.layout?.['icon-image'])
  }

  remove(): void {
    this.unsubscribe()
    clearTimeout(this.timer)
    const { map } = this.host
    for (const id of this.layers) if (map.getLayer(id)) map.removeLayer(id)
    if (map.getSource(this.id)) map.removeSource(this.id)
    this.host.overlay.request()
  }

  get isFaded(): boolean {
    return this.condition.isStale
  }

  private tell(condition: Condition): void {
    const { note, leftOut, isStale } = this.condition
    if (condition.note === note && condition.leftOut === leftOut && condition.isStale === isStale) return
    this.condition = condition
    if (condition.isStale !== isStale) this.host.applyGroup(this)
    this.host.onConditions()
  }

  private get setting(): Setting {
    const { store, projection } = this.host.app
    return { options: this.options, robot: store.state?.pose ?? [0, 0, 0], projection }
  }

  private async hear(message: unknown): Promise<void> {
    this.last = message
    this.heard++
    const { stretch } = this
    const state =
      this.type.kind !== 'tool' && this.type.kind !== 'tiles' && this.type.fold
        ? await this.type.fold(this.state as never, message as never, this.setting)
        : message
    if (stretch !== this.stretch) return
    this.state = state
    this.queue()
  }

  private queue(): void {
    if (this.type.kind === 'painted') this.host.overlay.request()
    else
      this.timer ||= window.setTimeout(() => {
        this.timer = 0
        this.draw()
      }, REDRAW_MS)
  }

  private addLayers(source: Source | null): void {
    if (this.type.kind === 'shapes') {
      // Without simplification: it swallows squares of a hand's width.
      this.host.map.addSource(this.id, { type: 'geojson', data: EMPTY, maxzoom: SOURCE_MAXZOOM, tolerance: 0 })
      for (const layer of lookLayers(this.id, this.host.app.projection.latDeg)) this.host.map.addLayer(layer)
      this.layers = lookLayers(this.id, this.host.app.projection.latDeg).map((layer) => layer.id)
    } else if (this.type.kind === 'laid') this.layers = [`${this.id}-picture`]
    else if (source?.tiles) this.addTiles(source.tiles)
  }

  private addTiles(tiles: MapSource): void {
    const { map } = this.host
    const url = new URL(tiles.url, location.origin).href.replace(/%7B/g, '{').replace(/%7D/g, '}')
    map.addSource(this.id, {
      type: 'raster',
      tiles: [url],
      tileSize: 256,
      minzoom: tiles.minzoom,
      maxzoom: tiles.maxzoom,
      ...(tiles.bounds ? { bounds: tiles.bounds } : {}),
    })
    map.addLayer({ id: this.id, type: 'raster', source: this.id }, 'grid-1')
    this.layers = [this.id]
  }

  private draw(): void {
    if (this.type.kind === 'shapes') {
      const drawing = new Drawing(this.host.app.projection)
      if (this.state !== undefined || this.type.needsNoSource)
        this.type.draw(this.state as never, drawing, this.setting)
      this.show(collection(drawing.features))
    } else if (this.type.kind === 'laid' && this.state !== undefined) void this.lay()
  }

  /** Where nothing has changed the map has nothing to paint. */
  private show(features: Features): void {
    const text = JSON.stringify(features)
    if (text === this.drawn) return
    this.drawn = text
    this.host.map.getSource<GeoJSONSource>(this.id)?.setData(features)
  }

  private async lay(): Promise<void> {
    if (this.type.kind !== 'laid') return
    const laid = await this.type.lay(this.state as never, this.setting)
    if (!laid) return
    const { map, app } = this.host
    const coordinates = laid.corners.map(([x, y]) => app.projection.toLonLat(x, y)) as [
      [number, number],
      [number, number],
      [number, number],
      [number, number],
    ]
    if (!map.getSource(this.id)) {
      map.addSource(this.id, { type: 'image', coordinates })
      map.addLayer(
        {
          id: this.layers[0],
          type: 'raster',
          source: this.id,
          paint: { 'raster-fade-duration': 0, 'raster-resampling': 'nearest' },
        },
        this.host.layerAbove(this),
      )
      this.host.adopt(this)
    }
    // Not by its address: that loads later, and a new picture would end the loading of the last one.
    map.getSource<ImageSource>(this.id)?.updateImage({ image: laid.image, coordinates })
  }
}
