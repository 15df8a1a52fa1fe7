/** The picture that is worked on: its classes, what was drawn, and whether that is saved. */

import { Emitter } from '../emitter.ts'
import type { LabelCanvas } from './canvas.ts'
import type { Painter } from './gestures.ts'
import { type Box, type Classes, fill, History, type Pieces, type Point, SOIL, stroke } from './painting.ts'
import * as server from './server.ts'

export type Tool = 'brush' | 'fill' | 'move'
interface Events {
  list: undefined
  change: undefined
  problem: string
}

const SAVE_AFTER_MS = 700
const SAVE_AGAIN_MS = 3000

export class Session extends Emitter<Events> implements Painter {
  about = ''
  pictures: server.PictureState[] = []
  current: server.PictureState | null = null
  tool: Tool = 'brush'
  kind = 1
  radius = 8
  isBusy = false
  isUnsaved = false
  private classes: Classes | null = null
  private revision = ''
  private pieces: Pieces | null = null
  private history = new History()
  private last: Point | null = null
  private paintKind = SOIL
  private timer = 0
  private saving: Promise<void> = Promise.resolve()
  private readonly unreadable = new Set<number>()

  constructor(private readonly canvas: LabelCanvas) {
    super()
  }

  get canUndo(): boolean {
    return this.history.canUndo
  }

  get canRedo(): boolean {
    return this.history.canRedo
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

  /** Opens what was begun last time, else the picture of which the network is least sure. */
  async start(): Promise<void> {
    await this.refresh()
    const begun = this.pictures.find((one) => one.state === 'draft')
    if (begun) await this.open(begun)
    if (!this.classes) await this.openNext()
    if (!this.classes && this.pictures[0]) await this.open(this.pictures[0])
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
      this.end()
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
    this.classes = saved?.classes ?? null
    this.revision = saved?.revision ?? ''
    this.pieces = null
    this.history = new History()
    if (image && saved) this.canvas.show(image, saved.classes)
    else this.canvas.clear()
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
    const { current, classes } = this
    if (!current || !classes || this.isBusy) return
    this.isBusy = true // what is painted meanwhile would begin it anew
    this.emit('change', undefined)
    try {
      this.end()
      await this.flush()
      await this.save(current, classes, true)
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
    this.emit('change', undefined)
    if (tool !== 'fill') this.canvas.showPieces(null)
    else if (this.current && this.classes) await this.loadPieces(this.current.number)
  }

  private async loadPieces(number: number): Promise<void> {
    try {
      const pieces = this.pieces ?? (await server.readPieces(number))
      if (this.current?.number !== number || this.tool !== 'fill') return
      this.pieces = pieces
      this.canvas.showPieces(pieces)
    } catch (error) {
      this.fail(error)
    }
  }

  isMoving(): boolean {
    return this.tool === 'move' || this.isBusy
  }

  begin(at: Point, isErasing: boolean): void {
    if (!this.classes) return
    this.paintKind = isErasing ? SOIL : this.kind
    this.history.begin(this.classes)
    this.last = at
    this.move(at)
  }

  move(at: Point): void {
    if (!this.classes || !this.last) return
    const box = this.paint(this.classes, this.last, at)
    this.last = at
    if (!box) return
    this.history.touch(box)
    this.canvas.draw(this.classes, box)
  }

  private paint(classes: Classes, from: Point, to: Point): Box | null {
    if (this.tool === 'brush') return stroke(classes, from, to, this.radius, this.paintKind)
    return this.pieces ? fill(classes, this.pieces, to, this.paintKind) : null
  }

  end(): void {
    this.last = null
    if (this.classes && this.history.end(this.classes)) this.saveSoon()
  }

  cancel(): void {
    this.last = null
    if (this.classes && this.history.end(this.classes)) this.redraw(this.history.undo(this.classes))
  }

  hover(at: Point | null): void {
    this.canvas.showCursor(this.tool === 'brush' ? at : null, this.radius)
  }

  undo(): void {
    this.end()
    if (this.classes) this.redraw(this.history.undo(this.classes))
  }

  redo(): void {
    this.end()
    if (this.classes) this.redraw(this.history.redo(this.classes))
  }

  private redraw(box: Box | null): void {
    if (!this.classes || !box) return
    this.canvas.draw(this.classes, box)
    this.saveSoon()
  }

  private saveSoon(afterMs = SAVE_AFTER_MS): void {
    this.isUnsaved = true
    clearTimeout(this.timer)
    this.timer = window.setTimeout(() => void this.flush().catch((error) => this.fail(error)), afterMs)
    this.emit('change', undefined)
  }

  /** Saves what was drawn as begun; one request at a time, the newest content last. */
  async flush(): Promise<void> {
    clearTimeout(this.timer)
    for (let sent: Promise<void> | null = null; sent !== this.saving; ) {
      sent = this.saving
      await sent
    }
    const { current, classes } = this
    if (!this.isUnsaved || !current || !classes) return
    this.isUnsaved = false
    const sent = this.save(current, classes, false)
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
      this.end()
      clearTimeout(this.timer)
      if (this.isUnsaved) await this.keep(current, classes)
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
    this.isUnsaved = false
  }

  private fail(error: unknown): void {
    this.emit('problem', error instanceof Error ? error.message : String(error))
  }
}
