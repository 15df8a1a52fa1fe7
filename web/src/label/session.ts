/** The picture that is worked on: its classes, what was drawn, and whether that is saved. */

import { Emitter } from '../emitter.ts'
import { AREA_NAMES, Areas, type AreaTool } from './areas.ts'
import type { LabelCanvas } from './canvas.ts'
import { Drawing, type PaintTool } from './drawing.ts'
import type { Painter } from './gestures.ts'
import { type Classes, CROP, type Point, SOIL } from './painting.ts'
import { say } from '../say.ts'
import * as server from './server.ts'

export type Tool = PaintTool | 'move'
interface Events {
  list: undefined
  change: undefined
  problem: string
}

const isOfAreas = (tool: Tool): tool is AreaTool => tool in AREA_NAMES
const textOf = (error: unknown): string => (error instanceof Error ? error.message : String(error))
/** How many strokes wait, in words. */
export const countWaiting = (strokes: number): string => say('strokesWait', { count: strokes })
const SAVE_AFTER_MS = 700
const SAVE_AGAIN_MS = 3000

export class Session extends Emitter<Events> implements Painter {
  about = ''
  pictures: server.PictureState[] = []
  current: server.PictureState | null = null
  tool: Tool = 'brush'
  kind = CROP
  radius = 8
  isBusy = false
  private isDirty = false
  private drawing: Drawing | null = null
  private areas: Areas | null = null
  private revision = ''
  private timer: ReturnType<typeof setTimeout> | undefined
  private saving: Promise<void> = Promise.resolve()
  private readonly unreadable = new Set<number>()

  constructor(private readonly canvas: LabelCanvas) {
    super()
  }

  get canUndo(): boolean {
    return this.drawing?.canUndo ?? false
  }

  get canRedo(): boolean {
    return this.drawing?.canRedo ?? false
  }

  /** Whether strokes wait for areas, or what was drawn is not saved yet. */
  get isUnsaved(): boolean {
    return this.isDirty || this.waitingCount > 0
  }

  get waitingCount(): number {
    return this.drawing?.waitingCount ?? 0
  }

  /** The areas that are being computed for what waits or for the tool, as the page names them; else null. */
  get computing(): string | null {
    const tool = this.drawing?.waitingTool ?? this.tool
    return isOfAreas(tool) && this.areas?.isComputing(tool) ? AREA_NAMES[tool] : null
  }

  get place(): number {
    return this.pictures.findIndex((one) => one.number === this.current?.number)
  }

  async refresh(): Promise<void> {
    const list = await server.listPictures()
    this.about = list.about
    this.pictures = list.pictures
    this.current = list.pictures.find((one) => one.number === this.current?.number) ?? this.current
    this.emit('list', undefined)
  }

  /** Opens what was begun last time, else the picture that the network is least sure about. */
  async start(): Promise<void> {
    await this.refresh()
    const begun = this.pictures.find((one) => one.state === 'draft')
    if (begun) await this.open(begun)
    if (!this.drawing) await this.openNext()
    if (!this.drawing && this.pictures[0]) await this.open(this.pictures[0])
  }

  /** Opens the first that is not finished, of those that can be read. */
  private async openNext(): Promise<void> {
    for (const one of this.pictures) {
      if (one.state === 'done' || this.unreadable.has(one.number)) continue
      await this.open(one)
      if (!this.unreadable.has(one.number)) return
    }
  }

  async open(picture: server.PictureState): Promise<void> {
    if (this.isBusy) return
    this.isBusy = true
    this.emit('change', undefined)
    try {
      await this.settle()
      await this.flush()
      await this.show(picture)
    } catch (error) {
      this.fail(error)
    } finally {
      this.isBusy = false
    }
    await this.setTool(this.tool)
  }

  private async show(picture: server.PictureState): Promise<void> {
    const [image, saved] = (await this.read(picture.number)) ?? [null, null]
    this.current = picture
    this.revision = saved?.revision ?? ''
    this.areas = new Areas((tool) => server.readAreas(picture.number, tool))
    this.drawing = saved && this.draw(saved.classes, this.areas)
    if (image && saved) this.canvas.show(image, saved.classes)
    else this.canvas.clear()
  }

  private draw(classes: Classes, areas: Areas): Drawing {
    const show = (): boolean => this.drawing?.classes === classes
    return new Drawing(
      classes,
      areas,
      (box) => show() && this.canvas.draw(classes, box),
      () => show() && this.saveSoon(),
    )
  }

  /** Null where the picture cannot be read: then it is left empty, and one goes on from there. */
  private async read(number: number): Promise<[ImageBitmap, server.SavedClasses] | null> {
    try {
      return await Promise.all([server.readPicture(number), server.readClasses(number)])
    } catch (error) {
      if (error instanceof server.NoAnswer) throw error
      this.unreadable.add(number)
      this.fail(error)
      return null
    }
  }

  async step(by: number): Promise<void> {
    const next = this.pictures[this.place + by]
    if (next) await this.open(next)
  }

  /** Saves the picture as finished and opens the next one that is not. */
  async finish(): Promise<void> {
    const { current, drawing } = this
    if (!current || !drawing || this.isBusy) return
    this.isBusy = true // what is painted meanwhile would begin it anew
    this.emit('change', undefined)
    try {
      await this.settle()
      await this.flush()
      await this.save(current, drawing.classes, true)
      await this.refresh()
    } catch (error) {
      this.fail(error)
      return
    } finally {
      this.isBusy = false
      this.emit('change', undefined)
    }
    await this.openNext()
  }

  async setTool(tool: Tool): Promise<void> {
    this.tool = tool
    this.canvas.showPieces(null)
    if (isOfAreas(tool)) await this.loadAreas(tool)
    else this.emit('change', undefined)
  }

  private async loadAreas(tool: AreaTool): Promise<void> {
    const { areas } = this
    if (!areas || !this.drawing) return
    try {
      const sent = areas.load(tool)
      this.emit('change', undefined)
      const pieces = await sent
      if (tool === 'fill' && this.tool === tool && areas === this.areas) this.canvas.showPieces(pieces)
      await this.drawWaiting()
    } catch (error) {
      this.fail(error)
    }
    this.emit('change', undefined)
  }

  /** Ends the stroke, and draws all that wait for areas to be computed. */
  private async settle(): Promise<void> {
    this.drawing?.end()
    await this.drawWaiting()
  }

  private async drawWaiting(): Promise<void> {
    try {
      await this.drawing?.settle()
    } catch (error) {
      throw new Error(say('strokesFailed', { waiting: countWaiting(this.waitingCount), problem: textOf(error) }))
    }
  }

  isMoving(): boolean {
    return this.tool === 'move' || this.isBusy
  }

  begin(at: Point, isErasing: boolean): void {
    if (this.tool === 'move') return
    this.drawing?.begin(this.tool, isErasing ? SOIL : this.kind, this.radius, at)
  }

  move(at: Point): void {
    this.drawing?.move(at)
  }

  end(): void {
    this.drawing?.end()
    if (!this.waitingCount) return
    this.emit('change', undefined)
    void this.drawWaiting().catch((error) => this.fail(error))
  }

  cancel(): void {
    this.drawing?.cancel()
    this.emit('change', undefined)
  }

  hover(at: Point | null): void {
    this.canvas.showCursor(this.tool === 'brush' || this.tool === 'rename' ? at : null, this.radius)
  }

  undo(): void {
    this.drawing?.undo()
    this.emit('change', undefined)
  }

  redo(): void {
    this.drawing?.redo()
    this.emit('change', undefined)
  }

  /** Gives everything of one class in this picture another one. */
  async renameAll(from: number, to: number): Promise<void> {
    if (!this.isBusy) await this.drawing?.renameAll(from, to).catch((error) => this.fail(error))
  }

  private saveSoon(afterMs = SAVE_AFTER_MS): void {
    this.isDirty = true
    clearTimeout(this.timer)
    this.timer = setTimeout(() => void this.flush().catch((error) => this.fail(error)), afterMs)
    this.emit('change', undefined)
  }

  /** Saves what was drawn as begun; one request at a time, the newest content last. */
  async flush(): Promise<void> {
    clearTimeout(this.timer)
    for (let sent: Promise<void> | null = null; sent !== this.saving; ) {
      sent = this.saving
      await sent
    }
    const { current, drawing } = this
    if (!this.isDirty || !current || !drawing) return
    this.isDirty = false
    const sent = this.save(current, drawing.classes, false)
    this.saving = sent.catch(() => undefined)
    try {
      await sent
      await this.refresh()
    } catch (error) {
      if (!(error instanceof server.SavedMeanwhile)) this.saveSoon(SAVE_AGAIN_MS)
      throw error
    } finally {
      this.emit('change', undefined)
    }
  }

  private async save(current: server.PictureState, classes: Classes, isDone: boolean): Promise<void> {
    try {
      this.revision = await server.saveClasses(current.number, classes.data, this.revision, isDone)
    } catch (error) {
      if (error instanceof server.SavedMeanwhile) await this.showTheirs(current, classes)
      throw error
    }
  }

  /** Shows what somebody else has saved, when the server has kept all that was drawn here. */
  private async showTheirs(current: server.PictureState, classes: Classes): Promise<void> {
    const wasBusy = this.isBusy
    this.isBusy = true
    try {
      await this.settle().catch((error) => this.fail(error))
      clearTimeout(this.timer)
      if (this.isDirty) await this.keep(current, classes)
      await this.show(current)
    } finally {
      this.isBusy = wasBusy
    }
    await this.refresh().catch(() => undefined)
    await this.setTool(this.tool)
  }

  /** Has the server keep what was drawn while it refused what had been drawn before. */
  private async keep(current: server.PictureState, classes: Classes): Promise<void> {
    try {
      await server.saveClasses(current.number, classes.data, this.revision, false)
    } catch (error) {
      if (!(error instanceof server.SavedMeanwhile)) throw error
    }
    this.isDirty = false
  }

  private fail(error: unknown): void {
    this.emit('problem', textOf(error))
  }
}
