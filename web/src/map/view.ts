/** The one map of the page: made on first use, then moved from screen to screen with its view. */

import * as maplibregl from 'maplibre-gl'
import type { GeoJSONSource, Map as MapLibre } from 'maplibre-gl'
import 'maplibre-gl/dist/maplibre-gl.css'
import workerUrl from 'maplibre-gl/dist/maplibre-gl-worker.mjs?worker&url'
import type { App } from '../app.ts'
import { palette } from '../shell/palette.ts'
import { onTheme } from '../shell/theme.ts'
import { Displays } from '../displays/displays.ts'
import { Display } from '../displays/display.ts'
import type { DisplayConfig } from '../displays/display.ts'
import type { DisplayHost, LayerGroup } from '../displays/host.ts'
import type { Features } from '../geojson.ts'
import type { Vec2 } from '../wire.ts'
import { boundsOf } from './features.ts'
import { addLayers, applyGroup, baseOpacities, layerGroups, opacitiesOf, recolour } from './layers.ts'
import type { SourceId } from './layers.ts'
import { LiveData } from './live.ts'
import { Capture } from './capture.ts'
import type { CaptureSize } from './capture.ts'
import { Overlay } from './overlay.ts'
import { RobotSight } from './robot-sight.ts'
import { serveLabels, soilTexture } from './texture.ts'
import { MapTools } from './tools.ts'
import { FOLLOWING, Tracking } from './tracking.ts'
import type { Target } from './tracking.ts'

maplibregl.setWorkerUrl(workerUrl)

const MAX_ZOOM = 24
const VIEW_KEY = 'map-view'
const NARROW_PX = 500

type Box = [west: number, south: number, east: number, north: number]

export interface SavedView {
  center?: Vec2
  zoom?: number
  bearing?: number
  follow?: boolean
  target?: Target
  turn?: number
  capture?: CaptureSize
  layers?: { id: string; visible: boolean; opacity: number }[]
  displays?: DisplayConfig[]
}

export class MapView implements DisplayHost {
  readonly node = document.createElement('div')
  readonly map: MapLibre
  readonly overlay: Overlay
  readonly tools: MapTools
  readonly capture: Capture
  readonly displays: Displays
  groups: LayerGroup[] = layerGroups()
  readonly tracking = new Tracking(this)
  /** The part of the earth that stays in view until somebody moves the map. */
  fitted: Box | null = null
  onGroups: () => void = () => undefined
  onConditions: () => void = () => undefined
  private base = new Map<string, unknown>()
  private loaded = false
  private seen = false
  private shownField = ''
  private readonly whenLoaded: (() => void)[] = []

  constructor(readonly app: App) {
    this.node.className = 'map'
    const colours = palette()
    this.map = new maplibregl.Map({
      container: this.node,
      center: app.projection.toLonLat(0, 0),
      zoom: 19,
      maxZoom: MAX_ZOOM,
      maxPitch: 0,
      attributionControl: false,
      dragRotate: true,
      trackResize: false,
      style: {
        version: 8,
        sources: {},
        layers: [{ id: 'background', type: 'background', paint: { 'background-color': colours.ground } }],
      },
    })
    this.map.addControl(new maplibregl.ScaleControl({ maxWidth: 120, unit: 'metric' }), 'bottom-left')
    this.overlay = new Overlay(this.map, app, colours)
    this.node.append(this.overlay.canvas)
    this.capture = new Capture(this.map, this.overlay.canvas)
    this.tools = new MapTools(this.map, app)
    this.overlay.sketch = this.tools.sketch
    this.overlay.proposals = this.tools.proposals
    this.displays = new Displays(this)
    this.overlay.paint = (surface) => this.displays.paint(surface)
    this.tools.onChange = () => this.overlay.request()
    serveLabels(this.map)
    this.map.on('load', () => this.load())
    this.map.on('dragstart', () => this.tracking.choose('map'))
    this.map.on('movestart', ({ originalEvent }) => {
      if (originalEvent) this.fitted = null
    })
    // A map that moves, or has another size than its screen, cannot go after the robot: it does so once it can,
    // also where the robot's next word is long in coming. After such a move the robot may be anywhere, at the edge of
    // the earth where the map ends: then the map waits for that word, instead of moving for ever.
    this.map.on('moveend', (event) => {
      if ('isFollowing' in event) return
      this.remember()
      this.tracking.follow()
    })
    this.map.on('resize', () => {
      if (this.fitted) this.fit(this.fitted, 0)
      this.tracking.follow()
    })
    // MapLibre's own observer reads the size up to 50 ms after a change, and keeps a wrong one for good
    // where a banner came and went meanwhile.
    new ResizeObserver(() => this.resize()).observe(this.node)
    onTheme(() => this.retheme())
    if (window.__agribot) Object.assign(window.__agribot, { map: this.map, goal: () => this.tools.proposals.goal })
  }

  /** Put the map into a screen. */
  attach(host: HTMLElement): void {
    host.prepend(this.node)
    this.map.resize()
    this.overlay.request()
  }

  /** Whether the canvas is as large as the map's place on the page. */
  get isFilled(): boolean {
    const canvas = this.map.getCanvas()
    return canvas.clientWidth === this.node.clientWidth && canvas.clientHeight === this.node.clientHeight
  }

  private resize(): void {
    if (!this.node.isConnected || this.isFilled) return
    this.map.resize()
    this.map.redraw() // a canvas of a new size is empty
  }

  ready(work: () => void): void {
    if (this.loaded) work()
    else this.whenLoaded.push(work)
  }

  setData(id: SourceId, data: Features): void {
    this.map.getSource<GeoJSONSource>(id)?.setData(data)
  }

  private load(): void {
    this.addTexture()
    addLayers(this.map, palette())
    this.base = baseOpacities(this.map)
    this.restoreLayers(this.saved())
    this.loaded = true
    new LiveData(this, this.app)
    this.app.onField(() => this.showField())
    const sight = new RobotSight(this.app)
    this.app.store.on('state', () => {
      if (sight.hasChanged(this.tools.proposals.goal)) this.overlay.request()
      this.tracking.follow()
    })
    void this.displays.start().then(() => this.restoreLayers(this.saved()))
    for (const work of this.whenLoaded) work()
  }

  private addTexture(): void {
    const texture = soilTexture(palette().texture)
    if (!texture) return
    if (this.map.hasImage('soil')) this.map.updateImage('soil', texture)
    else {
      this.map.addImage('soil', texture)
      this.map.addLayer({ id: 'soil', type: 'background', paint: { 'background-pattern': 'soil' } })
    }
  }

  /** A further entry of the layer list, shown as it was left. */
  addGroup(group: LayerGroup): void {
    if (group instanceof Display && group.type.kind === 'tiles') this.groups.push(group)
    else this.groups.unshift(group)
    this.adopt(group)
    this.onGroups()
  }

  /** Remember what the layers of a group look like untouched, and show them as they were left. */
  adopt(group: LayerGroup): void {
    for (const id of group.layers) for (const [name, value] of opacitiesOf(this.map, id)) this.base.set(name, value)
    const saved = this.saved()?.layers?.find((layer) => layer.id === group.id)
    if (saved) Object.assign(group, { visible: saved.visible, opacity: saved.opacity })
    this.applyGroup(group)
  }

  removeGroup(group: LayerGroup): void {
    this.groups = this.groups.filter((other) => other !== group)
    this.onGroups()
    this.remember()
  }

  /** Give a group another place in the list, which is the order of drawing. */
  moveGroup(group: LayerGroup, to: number): void {
    const others = this.groups.filter((other) => other !== group)
    others.splice(Math.max(0, to), 0, group)
    this.setOrder(others)
    this.onGroups()
    this.remember()
  }

  private setOrder(groups: LayerGroup[]): void {
    this.groups = groups
    const own = new Set(groups.flatMap((group) => group.layers))
    const isForeign = (id: string): boolean => !own.has(id) && id !== 'background' && id !== 'soil' // a drawing tool's
    const above = this.map.getStyle().layers.find(({ id }) => isForeign(id))?.id
    for (const group of [...groups].reverse())
      for (const id of group.layers) if (this.map.getLayer(id)) this.map.moveLayer(id, above)
  }

  /** The layer that a picture of this group has to lie below. */
  layerAbove(group: LayerGroup): string | undefined {
    const higher = this.groups.slice(0, Math.max(0, this.groups.indexOf(group))).reverse()
    return higher.flatMap(({ layers }) => layers).find((id) => this.map.getLayer(id))
  }

  private retheme(): void {
    const colours = palette()
    this.overlay.colours = colours
    this.ready(() => {
      recolour(this.map, colours)
      this.addTexture()
      for (const display of this.displays.all) display.retheme()
    })
    this.overlay.request()
  }

  applyGroup(group: LayerGroup): void {
    if (group.id === 'robot') this.overlay.showRobot = group.visible
    applyGroup(this.map, group, this.base)
    this.overlay.request()
    this.remember()
  }

  /** Bring all of the field into view again, if that is what is shown. */
  refit(): boolean {
    const box = this.fitted && this.wholeField()
    if (box) this.fit(box, 600, FOLLOWING)
    return box !== null
  }

  /** The whole field, north up. */
  overview(): void {
    const box = this.wholeField()
    if (!box) return
    this.tracking.choose('map')
    this.fit(box, 400)
  }

  private wholeField(): Box | null {
    const { field, store, projection } = this.app
    const points: Vec2[] = field
      ? [
          ...(field.boundary_map_m ?? []),
          ...field.rows.flatMap((r) => r.points_map_m),
          ...field.crop_map_m.flat(),
          ...field.waypoints_map_m,
        ]
      : []
    if (store.state?.pose) points.push([store.state.pose[0], store.state.pose[1]])
    return boundsOf(points, projection)
  }

  zoomBy(levels: number): void {
    this.fitted = null
    this.map.easeTo({ zoom: this.map.getZoom() + levels })
  }

  /** The field clear of the buttons; it stays so in a screen of another shape until the operator moves the map. */
  private fit(box: Box, durationMs: number, eventData = {}): void {
    const isNarrow = this.node.clientWidth < NARROW_PX
    // A low screen has two columns of buttons on the right.
    const isLow = matchMedia('(min-width: 600px) and (max-height: 560px)').matches
    const padding = {
      top: isNarrow ? 20 : 40,
      bottom: 40,
      left: isNarrow ? 20 : 72,
      right: isLow ? 112 : isNarrow ? 68 : 72,
    }
    this.map.fitBounds(box, { padding, maxZoom: 21, bearing: 0, duration: durationMs }, eventData)
    this.fitted = box
  }

  private showField(): void {
    const name = JSON.stringify(this.app.field?.datum) + this.app.field?.name
    if (!this.seen) this.firstView()
    else if (name !== this.shownField) {
      const { target } = this.tracking
      this.overview()
      this.tracking.choose(target)
    }
    this.shownField = name
  }

  private firstView(): void {
    this.seen = true
    const view = this.saved()
    if (view?.center) this.show(view)
    else {
      this.map.jumpTo({ center: this.app.projection.toLonLat(0, 0) })
      this.overview()
      this.tracking.choose('near')
    }
  }

  current(): SavedView {
    const { lng, lat } = this.map.getCenter()
    return {
      center: this.app.projection.toMap(lng, lat),
      zoom: this.map.getZoom(),
      bearing: this.map.getBearing(),
      target: this.tracking.target,
      turn: this.tracking.turnDeg,
      capture: this.capture.size,
      layers: this.groups.map(({ id, visible, opacity }) => ({ id, visible, opacity })),
      displays: this.displays.saved(),
    }
  }

  show(view: SavedView): void {
    this.fitted = null
    const center = view.center ? this.app.projection.toLonLat(...view.center) : this.map.getCenter()
    this.map.jumpTo({ center, zoom: view.zoom ?? this.map.getZoom(), bearing: view.bearing ?? 0 })
    this.capture.size = view.capture ?? 'window'
    this.tracking.set(view.target ?? (view.follow ? 'near' : 'map'), view.turn ?? 0)
    this.restoreLayers(view)
  }

  private restoreLayers(view: SavedView | null): void {
    if (view?.displays) this.displays.restore(view.displays)
    const order = new Map(view?.layers?.map(({ id }, i) => [id, i]))
    const place = (group: LayerGroup): number =>
      order.get(group.id) ?? (group instanceof Display && group.type.kind === 'tiles' ? Infinity : -1)
    const wanted = [...this.groups].sort((a, b) => place(a) - place(b) || 0)
    if (order.size && wanted.some((group, i) => group !== this.groups[i])) this.setOrder(wanted)
    for (const saved of view?.layers ?? []) {
      const group = this.groups.find((g) => g.id === saved.id)
      if (group) this.applyGroup(Object.assign(group, { visible: saved.visible, opacity: saved.opacity }))
    }
    for (const group of this.groups) if (!group.visible) this.applyGroup(group)
    this.onGroups()
  }

  remember(): void {
    if (this.seen && this.displays.started) localStorage.setItem(this.viewKey, JSON.stringify(this.current()))
  }

  private saved(): SavedView | null {
    const text = localStorage.getItem(this.viewKey)
    return text ? (JSON.parse(text) as SavedView) : null
  }

  private get viewKey(): string {
    return `${VIEW_KEY}:${this.app.field?.name ?? ''}`
  }
}
