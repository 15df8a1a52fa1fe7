/** What moves 30 times a second or follows the finger: drawn on a canvas over the map, not through its tiles. */

import type { Map as MapLibre } from 'maplibre-gl'
import type { App } from '../app.ts'
import { placeOutline } from '../geo.ts'
import { joinRobot } from '../trajectory.ts'
import type { Vec2 } from '../wire.ts'
import type { Palette } from '../shell/palette.ts'
import type { Surface } from '../displays/instruments.ts'
import type { Proposal, Proposals } from './proposal.ts'
import type { Sketch } from './tools.ts'

const FALLBACK_OUTLINE: Vec2[] = [
  [0.4, 0.3],
  [0.4, -0.3],
  [-0.4, -0.3],
  [-0.4, 0.3],
]
const SMALLEST_ROBOT_PX = 22
const SIGMAS = 2.4477 // 95 % of a two-dimensional normal distribution

export class Overlay {
  readonly canvas = document.createElement('canvas')
  private readonly pen: CanvasRenderingContext2D | null
  private queued = false
  colours: Palette
  showRobot = true
  tail: Vec2[] = []
  sketch: Sketch | null = null
  proposals: Proposals | null = null
  /** Instruments and pictures of displays. */
  paint: (surface: Surface) => void = () => undefined

  constructor(
    private readonly map: MapLibre,
    private readonly app: App,
    colours: Palette,
  ) {
    this.colours = colours
    this.canvas.className = 'map-overlay'
    this.canvas.setAttribute('aria-hidden', 'true')
    this.pen = this.canvas.getContext('2d')
    map.on('render', () => this.draw())
  }

  /** Draw before the next frame, unless the map itself is about to. */
  request(): void {
    if (this.queued) return
    this.queued = true
    requestAnimationFrame(() => {
      this.queued = false
      this.draw()
    })
  }

  private at(p: Vec2): Vec2 {
    const { x, y } = this.map.project(this.app.projection.toLonLat(p[0], p[1]))
    return [x, y]
  }

  private draw(): void {
    const pen = this.pen
    const box = this.map.getContainer()
    const ratio = window.devicePixelRatio || 1
    const [w, h] = [Math.round(box.clientWidth * ratio), Math.round(box.clientHeight * ratio)]
    if (!pen || !w || !h) return
    if (this.canvas.width !== w || this.canvas.height !== h) {
      this.canvas.width = w
      this.canvas.height = h
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0)
    pen.clearRect(0, 0, w, h)
    if (this.showRobot) {
      this.drawTail(pen)
      this.drawRobot(pen)
    }
    this.paint(this.surface(pen, box.clientWidth, box.clientHeight))
    if (this.proposals) this.drawGoals(pen, this.proposals)
    if (this.sketch) this.drawSketch(pen, this.sketch)
  }

  /** Where the robot is driving to on demand, and what is proposed. */
  private drawGoals(pen: CanvasRenderingContext2D, { goal, now }: Proposals): void {
    if (goal) this.target(pen, this.at(goal), this.colours.goal)
    if (now) this.drawProposal(pen, now)
  }

  private drawProposal(pen: CanvasRenderingContext2D, { at, yaw, way }: Proposal): void {
    if (way && way.points_map_m.length > 1) {
      pen.lineJoin = pen.lineCap = 'round'
      for (const [colour, width, dash] of [
        [this.colours.halo, 6, []],
        [this.colours.tool, 3, [2, 7]],
      ] as const) {
        this.polyline(pen, way.points_map_m)
        pen.setLineDash([...dash])
        pen.strokeStyle = colour
        pen.lineWidth = width
        pen.stroke()
      }
      pen.setLineDash([])
    }
    if (yaw !== null) {
      pen.globalAlpha = 0.4
      this.polyline(pen, placeOutline(this.app.robot?.footprint_body_m ?? FALLBACK_OUTLINE, at[0], at[1], yaw), true)
      pen.fillStyle = this.colours.robot
      pen.fill()
      pen.globalAlpha = 1
      this.arrow(pen, this.at(at), yaw)
    }
    this.target(pen, this.at(at), this.colours.tool)
  }

  /** A ring around a dot. */
  private target(pen: CanvasRenderingContext2D, [x, y]: Vec2, colour: string): void {
    for (const [line, width] of [
      [this.colours.halo, 7],
      [colour, 3.5],
    ] as const) {
      pen.beginPath()
      pen.arc(x, y, 13, 0, 7)
      pen.strokeStyle = line
      pen.lineWidth = width
      pen.stroke()
    }
    pen.beginPath()
    pen.arc(x, y, 4, 0, 7)
    pen.fillStyle = colour
    pen.fill()
  }

  private surface(pen: CanvasRenderingContext2D, width: number, height: number): Surface {
    const [[x0, y0], [x1, y1]] = [this.at([0, 0]), this.at([1, 0])]
    return {
      pen,
      width,
      height,
      at: (x, y) => this.at([x, y]),
      pxPerM: Math.hypot(x1 - x0, y1 - y0),
      bearing: (this.map.getBearing() * Math.PI) / 180,
      repaint: () => this.request(),
    }
  }

  private polyline(pen: CanvasRenderingContext2D, points: Vec2[], close = false): void {
    pen.beginPath()
    for (const p of points) pen.lineTo(...this.at(p))
    if (close) pen.closePath()
  }

  private drawTail(pen: CanvasRenderingContext2D): void {
    const pose = this.app.store.state?.pose
    if (!this.tail.length || !pose) return
    this.polyline(pen, joinRobot(this.tail, [pose[0], pose[1]]))
    pen.strokeStyle = this.colours.trajectory
    pen.lineWidth = Math.min(5, Math.max(1.5, 1.5 + (this.map.getZoom() - 16) * 0.5))
    pen.lineJoin = pen.lineCap = 'round'
    pen.stroke()
  }

  private drawRobot(pen: CanvasRenderingContext2D): void {
    const state = this.app.store.state
    if (!state?.pose) return
    const [x, y, yaw] = state.pose
    const [px, py] = this.at([x, y])
    const [ex, ey] = this.at([x + 1, y])
    const pxPerM = Math.hypot(ex - px, ey - py)
    if (state.pos_std_m !== null && state.yaw_std_rad !== null)
      this.drawUncertainty(pen, [px, py], yaw, [state.pos_std_m, state.yaw_std_rad], pxPerM)
    const outline = this.app.robot?.footprint_body_m ?? FALLBACK_OUTLINE
    const lengthM = Math.max(...outline.map((p) => p[0])) - Math.min(...outline.map((p) => p[0]))
    const scale = Math.max(1, SMALLEST_ROBOT_PX / (lengthM * pxPerM))
    const grown = outline.map(([bx, by]): Vec2 => [bx * scale, by * scale])
    const nose = Math.max(...grown.map((p) => p[0]))
    const half = Math.max(...grown.map((p) => p[1]))
    pen.lineJoin = 'round'
    pen.lineWidth = 2
    this.polyline(pen, placeOutline(grown, x, y, yaw), true)
    pen.fillStyle = this.colours.robot
    pen.strokeStyle = this.colours.robotEdge
    pen.fill()
    pen.stroke()
    this.polyline(
      pen,
      placeOutline(
        [
          [nose * 0.85, 0],
          [nose * 0.15, half * 0.6],
          [nose * 0.15, -half * 0.6],
        ],
        x,
        y,
        yaw,
      ),
      true,
    )
    pen.fillStyle = this.colours.robotEdge
    pen.fill()
  }

  private drawUncertainty(
    pen: CanvasRenderingContext2D,
    at: Vec2,
    yaw: number,
    std: [number, number],
    pxPerM: number,
  ): void {
    const radius = std[0] * SIGMAS * pxPerM
    if (radius > 4) {
      pen.beginPath()
      pen.ellipse(at[0], at[1], radius, radius, 0, 0, 2 * Math.PI)
      pen.globalAlpha = 0.18
      pen.fillStyle = this.colours.ellipse
      pen.fill()
      pen.globalAlpha = 0.9
      pen.strokeStyle = this.colours.ellipse
      pen.lineWidth = 1.5
      pen.stroke()
    }
    const spread = Math.min(Math.PI, std[1] * SIGMAS)
    const reach = 44
    pen.globalAlpha = 0.22
    pen.beginPath()
    pen.moveTo(...at)
    const bearing = (this.map.getBearing() * Math.PI) / 180
    pen.arc(at[0], at[1], reach, -yaw - bearing - spread, -yaw - bearing + spread)
    pen.closePath()
    pen.fillStyle = this.colours.ellipse
    pen.fill()
    pen.globalAlpha = 1
  }

  private drawSketch(pen: CanvasRenderingContext2D, sketch: Sketch): void {
    const { tool, halo } = this.colours
    if (sketch.area.length > 2) {
      this.polyline(pen, sketch.area, true)
      pen.globalAlpha = 0.2
      pen.fillStyle = tool
      pen.fill()
      pen.globalAlpha = 1
      pen.strokeStyle = tool
      pen.lineWidth = 3
      pen.stroke()
    }
    if (sketch.points.length > 1) {
      for (const [colour, width] of [
        [halo, 6],
        [tool, 3],
      ] as const) {
        this.polyline(pen, sketch.points)
        pen.strokeStyle = colour
        pen.lineWidth = width
        pen.stroke()
      }
    }
    for (const p of sketch.points) this.dot(pen, this.at(p))
    if (sketch.arrow) this.arrow(pen, this.at(sketch.arrow.from), sketch.arrow.yaw)
    sketch.labels.forEach(({ at, text }) => this.text(pen, this.at(at), text))
  }

  private dot(pen: CanvasRenderingContext2D, [x, y]: Vec2): void {
    pen.beginPath()
    pen.arc(x, y, 6, 0, 7)
    pen.fillStyle = this.colours.tool
    pen.strokeStyle = this.colours.halo
    pen.lineWidth = 2
    pen.fill()
    pen.stroke()
  }

  private arrow(pen: CanvasRenderingContext2D, [x, y]: Vec2, yaw: number | null): void {
    this.dot(pen, [x, y])
    if (yaw === null) return
    const turn = -yaw - (this.map.getBearing() * Math.PI) / 180
    pen.save()
    pen.translate(x, y)
    pen.rotate(turn)
    pen.beginPath()
    pen.moveTo(0, 0)
    pen.lineTo(58, 0)
    pen.moveTo(44, -10)
    pen.lineTo(60, 0)
    pen.lineTo(44, 10)
    pen.lineWidth = 4
    pen.strokeStyle = this.colours.tool
    pen.stroke()
    pen.restore()
  }

  private text(pen: CanvasRenderingContext2D, [x, y]: Vec2, words: string): void {
    pen.font = '600 13px system-ui, sans-serif'
    pen.lineJoin = 'round'
    pen.lineWidth = 4
    pen.strokeStyle = this.colours.halo
    pen.strokeText(words, x + 10, y - 8)
    pen.fillStyle = this.colours.ink
    pen.fillText(words, x + 10, y - 8)
  }
}
