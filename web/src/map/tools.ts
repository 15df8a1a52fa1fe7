/** The map's tools: measure, read a position, RViz's pose estimate, goal and point. */

import type { Map as MapLibre, MapMouseEvent } from 'maplibre-gl'
import type { App } from '../app.ts'
import { areaM2, compassText, distanceM, lengthM } from '../geo.ts'
import { area, metres } from '../format.ts'
import type { IconName } from '../icons.ts'
import type { Vec2 } from '../wire.ts'

export type ToolId = 'pan' | 'measure' | 'coordinates' | 'goal' | 'pose' | 'point'
export interface Sketch {
  points: Vec2[]
  arrow: { from: Vec2; yaw: number | null } | null
  labels: { at: Vec2; text: string }[]
}
export interface ToolInfo { id: ToolId; title: string; icon: IconName; hint: string; commands: boolean }

export const TOOLS: ToolInfo[] = [
  { id: 'measure', title: 'Measure', icon: 'measure', hint: 'Tap points to measure along them.', commands: false },
  { id: 'coordinates', title: 'Read position', icon: 'pin', hint: 'Tap the map to read a position.', commands: false },
  { id: 'goal', title: 'Drive to a place', icon: 'goal', hint: 'Tap the goal, or press and drag to set the heading too.', commands: true },
  { id: 'pose', title: 'Correct the robot’s pose', icon: 'pose', hint: 'Press where the robot is, drag to where it looks.', commands: true },
  { id: 'point', title: 'Publish a point', icon: 'point', hint: 'Tap a point to send it to the programs that listen.', commands: true },
]

const DRAG_PX = 12

export class MapTools {
  tool: ToolId = 'pan'
  readonly sketch: Sketch = { points: [], arrow: null, labels: [] }
  onChange: () => void = () => undefined
  onText: (text: string) => void = () => undefined
  private pressed: { at: Vec2; px: Vec2 } | null = null

  constructor(private readonly map: MapLibre, private readonly app: App) {
    map.on('click', (event) => this.click(event))
    const canvas = map.getCanvasContainer()
    canvas.addEventListener('pointerdown', (event) => this.press(event))
    canvas.addEventListener('pointermove', (event) => this.drag(event))
    canvas.addEventListener('pointerup', (event) => void this.release(event))
    canvas.addEventListener('pointercancel', () => this.clear())
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
    this.onChange()
  }

  private click(event: MapMouseEvent): void {
    const p = this.app.projection.toMap(event.lngLat.lng, event.lngLat.lat)
    if (this.tool === 'measure') this.measure(p)
    else if (this.tool === 'coordinates') this.read(p, event)
    else if (this.tool === 'point') {
      this.sketch.points = [p]
      this.onChange()
      void this.app.command({ k: 'point', x: p[0], y: p[1] }, `Point sent: ${metres(p[0])} east, ${metres(p[1])} north.`)
    }
  }

  private measure(p: Vec2): void {
    const { points, labels } = this.sketch
    if (points.length) labels.push({ at: p, text: metres(distanceM(points[points.length - 1], p)) })
    points.push(p)
    const enclosed = points.length > 2 ? ` · encloses ${area(areaM2(points))}` : ''
    this.onText(`Total ${metres(lengthM(points))}${enclosed}`)
    this.onChange()
  }

  private read(p: Vec2, event: MapMouseEvent): void {
    this.sketch.points = [p]
    const { lat, lng } = event.lngLat
    this.onText(`E ${p[0].toFixed(3)} m  N ${p[1].toFixed(3)} m · ${lat.toFixed(8)}, ${lng.toFixed(8)}`)
    this.onChange()
  }

  private where(event: PointerEvent): { at: Vec2; px: Vec2 } {
    const box = this.map.getCanvas().getBoundingClientRect()
    const px: Vec2 = [event.clientX - box.left, event.clientY - box.top]
    const { lng, lat } = this.map.unproject(px)
    return { at: this.app.projection.toMap(lng, lat), px }
  }

  private press(event: PointerEvent): void {
    if (this.tool !== 'goal' && this.tool !== 'pose') return
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
    if (far) this.onText(`Heading ${compassText(yaw)} from north`)
    this.onChange()
  }

  private async release(event: PointerEvent): Promise<void> {
    this.drag(event)
    const arrow = this.sketch.arrow
    this.pressed = null
    if (!arrow) return
    const [x, y] = arrow.from
    if (this.tool === 'goal') await this.app.command({ k: 'goto', x, y, yaw: arrow.yaw }, 'The robot drives to the goal.')
    else if (arrow.yaw !== null) await this.app.command({ k: 'pose_estimate', x, y, yaw: arrow.yaw }, 'Pose corrected.')
    this.clear()
  }
}
