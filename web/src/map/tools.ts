/** The map's tools: measure, read a position, RViz's pose estimate, goal and point. */

import type { Map as MapLibre, MapMouseEvent } from 'maplibre-gl'
import { api } from '../api.ts'
import type { App } from '../app.ts'
import type { ToolId } from '../displays/host.ts'
import { areaM2, compassText, distanceM, lengthM } from '../geo.ts'
import { area, metres } from '../format.ts'
import { Proposals } from './proposal.ts'
import type { IconName } from '../icons.ts'
import type { PageRequest, Vec2 } from '../wire.ts'
import { decimals, say } from '../say.ts'

export interface Sketch {
  points: Vec2[]
  /** The polygon that was finished last; it stays until another is drawn. */
  area: Vec2[]
  arrow: { from: Vec2; yaw: number | null } | null
  labels: { at: Vec2; text: string }[]
}
export interface ToolInfo {
  id: ToolId
  title: string
  icon: IconName
  hint: string
  commands: boolean
}

export const TOOLS: ToolInfo[] = [
  { id: 'measure', title: say('measure'), icon: 'measure', hint: say('hintMeasure'), commands: false },
  { id: 'coordinates', title: say('readPosition'), icon: 'pin', hint: say('hintRead'), commands: false },
  {
    id: 'goal',
    title: say('driveToAPlace'),
    icon: 'goal',
    hint: say('hintGoTo'),
    commands: true,
  },
  {
    id: 'pose',
    title: say('correctRobotPose'),
    icon: 'pose',
    hint: say('hintPose'),
    commands: true,
  },
  {
    id: 'point',
    title: say('publishAPoint'),
    icon: 'point',
    hint: say('hintPoint'),
    commands: true,
  },
  {
    id: 'polygon',
    title: say('drawAPolygon'),
    icon: 'polygon',
    hint: say('hintCorners'),
    commands: true,
  },
  {
    id: 'route',
    title: say('planARoute'),
    icon: 'line',
    hint: say('hintRoute'),
    commands: true,
  },
]

const TOOLS_BY_ID = Object.fromEntries(TOOLS.map((tool) => [tool.id, tool]))
const DRAG_PX = 12
const DOUBLE_TAP_MS = 350

export class MapTools {
  tool: ToolId = 'pan'
  readonly sketch: Sketch = { points: [], area: [], arrow: null, labels: [] }
  onChange: () => void = () => undefined
  onText: (text: string) => void = () => undefined
  /** What a tool has read, for the clipboard. */
  copied = ''
  readonly proposals: Proposals
  private pressed: { at: Vec2; px: Vec2 } | null = null
  private readonly pointers = new Set<number>()
  /** More than one finger has been down since the map was last without a finger. */
  private isGesture = false
  private tap = 0

  constructor(
    private readonly map: MapLibre,
    private readonly app: App,
  ) {
    map.on('click', (event) => this.click(event))
    const canvas = map.getCanvasContainer()
    canvas.addEventListener('pointerdown', (event) => this.press(event))
    canvas.addEventListener('pointermove', (event) => this.drag(event))
    for (const name of ['pointerup', 'pointercancel'] as const)
      window.addEventListener(name, (event) => this.release(event))
    map.on('dblclick', () => clearTimeout(this.tap))
    this.proposals = new Proposals(app)
    this.proposals.onChange = () => this.onChange()
  }

  choose(tool: ToolId): void {
    this.tool = tool
    this.clear()
    const draws = tool === 'goal' || tool === 'pose'
    this.map.dragPan[draws ? 'disable' : 'enable']()
    this.map.getCanvas().style.cursor = tool === 'pan' ? '' : 'crosshair'
    this.onText(TOOLS.find((t) => t.id === tool)?.hint ?? '')
  }

  private clear(): void {
    this.pressed = null
    this.sketch.points = []
    this.sketch.labels = []
    this.sketch.arrow = null
    this.copied = ''
    clearTimeout(this.tap)
    this.proposals.drop()
  }

  private click(event: MapMouseEvent): void {
    const p = this.app.projection.toMap(event.lngLat.lng, event.lngLat.lat)
    if (this.tool === 'measure') this.measure(p)
    else if (this.tool === 'coordinates') this.read(p, event)
    else if (this.tool === 'point') this.point(p)
    else if (this.tool === 'polygon') this.corner(p)
    else if (this.tool === 'route') this.stop(p)
  }

  /** Sent when it is clear that no second tap follows, which would zoom. */
  private point(p: Vec2): void {
    this.sketch.points = [p]
    this.onChange()
    clearTimeout(this.tap)
    this.tap = window.setTimeout(
      () => void this.publish('point', [p], say('pointSent', { east: decimals(p[0], 2), north: decimals(p[1], 2) })),
      DOUBLE_TAP_MS,
    )
  }

  private isNear(a: Vec2, b: Vec2): boolean {
    const [pa, pb] = [a, b].map((p) => this.map.project(this.app.projection.toLonLat(...p)))
    return Math.hypot(pa.x - pb.x, pa.y - pb.y) < DRAG_PX
  }

  private corner(p: Vec2): void {
    const { points } = this.sketch
    if (points.length > 2 && this.isNear(p, points[0])) {
      this.sketch.area = points.slice()
      this.sketch.points = []
      void this.publish('polygon', this.sketch.area, say('polygonSent', { area: area(areaM2(this.sketch.area)) }))
    } else points.push(p)
    const figures = { count: points.length, area: area(areaM2(points)) }
    this.onText(points.length > 2 ? say('polygonCorners', figures) : TOOLS_BY_ID.polygon.hint)
    this.onChange()
  }

  private stop(p: Vec2): void {
    const { points } = this.sketch
    const pose = this.app.store.state?.pose
    if (!points.length && pose) points.push([pose[0], pose[1]])
    if (points.length > 1 && this.isNear(p, points[points.length - 1])) {
      void this.publish('route', points, say('routeSent', { length: metres(lengthM(points)) }))
      return
    }
    points.push(p)
    this.onText(say('routeStops', { count: points.length - 1, length: metres(lengthM(points)) }))
    this.onChange()
  }

  /** Into the recording, and to the programs that listen for it; what they answer is shown. */
  private async publish(what: 'point' | 'polygon' | 'route', xy: Vec2[], done: string): Promise<void> {
    const [[x_map_m, y_map_m]] = xy
    const command: PageRequest =
      what === 'point'
        ? { kind: 'point_out', x_map_m, y_map_m }
        : { kind: 'draw_shape', shape: what, corners_map_m: xy }
    if (!(await this.app.command(command, done))) return
    const listeners = ((await this.app.attempt(api.panels())) ?? []).filter(
      (panel) => panel.kind === 'listener' && panel.what === what,
    )
    for (const { id } of listeners) {
      const response = await this.app.attempt(api.submitPanel(id, { points: xy }))
      const answer = response && ((await response.json()) as { text?: string })
      if (answer?.text) this.app.toasts.show('info', answer.text)
    }
  }

  private measure(p: Vec2): void {
    const { points, labels } = this.sketch
    if (points.length) labels.push({ at: p, text: metres(distanceM(points[points.length - 1], p)) })
    points.push(p)
    const figures = { length: metres(lengthM(points)), area: area(areaM2(points)) }
    this.onText(points.length > 2 ? say('measuredArea', figures) : say('measuredLength', figures))
    this.onChange()
  }

  private read(p: Vec2, event: MapMouseEvent): void {
    this.sketch.points = [p]
    const { lat, lng } = event.lngLat
    this.copied = `${lat.toFixed(8)}, ${lng.toFixed(8)}`
    this.onText(say('positionRead', { east: decimals(p[0], 3), north: decimals(p[1], 3), place: this.copied }))
    this.onChange()
  }

  private where(event: PointerEvent): { at: Vec2; px: Vec2 } {
    const box = this.map.getCanvas().getBoundingClientRect()
    const px: Vec2 = [event.clientX - box.left, event.clientY - box.top]
    const { lng, lat } = this.map.unproject(px)
    return { at: this.app.projection.toMap(lng, lat), px }
  }

  private press(event: PointerEvent): void {
    this.pointers.add(event.pointerId)
    if (this.pointers.size > 1) this.isGesture = true
    this.letGo()
    if (this.isGesture || event.button !== 0 || (this.tool !== 'goal' && this.tool !== 'pose')) return
    this.pressed = this.where(event)
    this.sketch.arrow = { from: this.pressed.at, yaw: null }
    this.onChange()
  }

  private drag(event: PointerEvent): void {
    if (!this.pressed || !this.sketch.arrow) return
    const now = this.where(event)
    const far = Math.hypot(now.px[0] - this.pressed.px[0], now.px[1] - this.pressed.px[1]) > DRAG_PX
    const yaw = Math.atan2(now.at[1] - this.pressed.at[1], now.at[0] - this.pressed.at[0])
    this.sketch.arrow.yaw = far ? yaw : null
    if (far) this.onText(say('headingFromNorth', { heading: compassText(yaw) }))
    this.onChange()
  }

  /** What one finger has shown is proposed; two fingers move the map and show nothing. */
  private release(event: PointerEvent): void {
    if (!this.pointers.delete(event.pointerId)) return
    this.drag(event)
    const arrow = this.sketch.arrow
    this.letGo()
    if (this.pointers.size === 0) this.isGesture = false
    if (!arrow || event.type !== 'pointerup') return
    if (this.tool === 'goal') this.proposals.propose('goal', arrow.from, arrow.yaw)
    else if (this.tool === 'pose' && arrow.yaw !== null) this.proposals.propose('pose', arrow.from, arrow.yaw)
    this.onText(TOOLS_BY_ID[this.tool]?.hint ?? '')
  }

  private letGo(): void {
    this.pressed = null
    this.sketch.arrow = null
    this.onChange()
  }
}
