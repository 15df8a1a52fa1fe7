/** What is drawn on one picture: strokes in their order, also those that wait for areas to be computed. */

import { AREA_NAMES, type Areas, type AreaTool } from './areas.ts'
import { type Box, type Classes, fill, History, type Pieces, type Point, stroke } from './painting.ts'
import { isVegetation, namePlants, renameAll } from './plants.ts'

export type PaintTool = AreaTool | 'brush' | 'rename'
type Painted = Box | null

interface Stroke {
  tool: PaintTool
  kind: number
  radius: number
  points: Point[]
}

const isOfAreas = (tool: PaintTool): tool is AreaTool => tool in AREA_NAMES

function paint(
  classes: Classes,
  { tool, kind, radius }: Stroke,
  pieces: Pieces | null,
  from: Point,
  to: Point,
): Painted {
  if (tool === 'brush') return stroke(classes, from, to, radius, kind)
  if (tool === 'rename') return stroke(classes, from, to, radius, kind, isVegetation)
  if (!pieces) return null
  return tool === 'fill' ? fill(classes, pieces, to, kind) : namePlants(classes, pieces, from, to, kind)
}

export class Drawing {
  private readonly history = new History()
  private readonly waiting: Stroke[] = []
  private now: Stroke | null = null
  private settling: Promise<void> | null = null

  constructor(
    readonly classes: Classes,
    private readonly areas: Areas,
    /** A part of the classes was painted. */
    private readonly onPaint: (box: Box) => void,
    /** A step was done, undone or redone: it has to be saved. */
    private readonly onStep: () => void,
  ) {}

  get canUndo(): boolean {
    return this.history.canUndo || this.waiting.length > 0
  }

  get canRedo(): boolean {
    return this.history.canRedo && !this.waiting.length
  }

  /** How many strokes wait for areas to be computed. */
  get waitingCount(): number {
    return this.waiting.length
  }

  /** The tool of the stroke that waits first, else null. */
  get waitingTool(): PaintTool | null {
    return this.waiting[0]?.tool ?? null
  }

  begin(tool: PaintTool, kind: number, radius: number, at: Point): void {
    this.end()
    this.now = { tool, kind, radius, points: [at] }
    const isLater = this.waiting.length > 0 || (isOfAreas(tool) && !this.areas.get(tool))
    if (isLater) this.waiting.push(this.now)
    else this.history.begin(this.classes)
    this.paintTo(this.now, at)
  }

  move(at: Point): void {
    if (!this.now) return
    this.paintTo(this.now, at)
    this.now.points.push(at)
  }

  private paintTo(stroke: Stroke, to: Point): void {
    if (!this.waiting.includes(stroke)) this.paint(stroke, stroke.points.at(-1) ?? to, to)
  }

  private paint(stroke: Stroke, from: Point, to: Point): void {
    const pieces = isOfAreas(stroke.tool) ? this.areas.get(stroke.tool) : null
    const box = paint(this.classes, stroke, pieces, from, to)
    if (!box) return
    this.history.touch(box)
    this.onPaint(box)
  }

  /** Ends a stroke; one that waits is drawn by `settle`. */
  end(): void {
    const stroke = this.now
    this.now = null
    if (stroke && !this.waiting.includes(stroke)) this.keep()
  }

  private keep(): void {
    if (this.history.end(this.classes)) this.onStep()
  }

  /** Takes back the stroke that is being drawn. */
  cancel(): void {
    const stroke = this.now
    this.now = null
    if (!stroke) return
    if (this.waiting.includes(stroke)) this.waiting.pop()
    else if (this.history.end(this.classes)) this.step(this.history.undo(this.classes))
  }

  /** Draws the strokes that wait, as soon as their areas are here; it fails where these cannot be had. */
  settle(): Promise<void> {
    this.settling ??= this.drawWaiting().finally(() => {
      this.settling = null
    })
    return this.settling
  }

  private async drawWaiting(): Promise<void> {
    for (let next = this.waiting[0]; next && next !== this.now; next = this.waiting[0]) {
      if (isOfAreas(next.tool)) await this.areas.load(next.tool)
      if (this.waiting[0] !== next || next === this.now) continue // taken back meanwhile
      this.waiting.shift()
      this.drawStroke(next)
    }
  }

  private drawStroke(stroke: Stroke): void {
    this.history.begin(this.classes)
    for (const [i, at] of stroke.points.entries()) this.paint(stroke, stroke.points[i - 1] ?? at, at)
    this.keep()
  }

  /** Gives all pixels of one class another one, after the strokes that wait. */
  async renameAll(from: number, to: number): Promise<void> {
    this.end()
    await this.settle()
    this.history.begin(this.classes)
    const box = renameAll(this.classes, from, to)
    if (box) this.history.touch(box)
    if (box) this.onPaint(box)
    this.keep()
  }

  undo(): void {
    this.end()
    if (this.waiting.length) this.waiting.pop()
    else this.step(this.history.undo(this.classes))
  }

  redo(): void {
    this.end()
    if (this.canRedo) this.step(this.history.redo(this.classes))
  }

  private step(box: Painted): void {
    if (!box) return
    this.onPaint(box)
    this.onStep()
  }
}
