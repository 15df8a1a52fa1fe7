/** Pointers on the picture: one draws, two or the middle button move and zoom, the wheel zooms. */

import type { LabelCanvas } from './canvas.ts'
import type { Point } from './painting.ts'

export interface Painter {
  begin(at: Point, isErasing: boolean): void
  move(at: Point): void
  end(): void
  cancel(): void
  hover(at: Point | null): void
  isMoving(): boolean
}

const MIDDLE = 1
const RIGHT = 2
const WHEEL_RATE = 0.0016

export class Gestures {
  private readonly pointers = new Map<number, PointerEvent>()
  private drawing: number | null = null

  constructor(
    private readonly canvas: LabelCanvas,
    private readonly painter: Painter,
  ) {
    const { node } = canvas
    node.addEventListener('pointerdown', (event) => this.down(event))
    node.addEventListener('pointermove', (event) => this.move(event))
    for (const name of ['pointerup', 'pointercancel'] as const) node.addEventListener(name, (event) => this.up(event))
    node.addEventListener('pointerleave', () => painter.hover(null))
    node.addEventListener('contextmenu', (event) => event.preventDefault())
    node.addEventListener(
      'wheel',
      (event) => {
        event.preventDefault()
        canvas.zoom(Math.exp(-WHEEL_RATE * event.deltaY), { x: event.clientX, y: event.clientY })
        painter.hover(canvas.locate(event))
      },
      { passive: false },
    )
  }

  private down(event: PointerEvent): void {
    this.canvas.node.setPointerCapture(event.pointerId)
    this.pointers.set(event.pointerId, event)
    const isPan = this.pointers.size > 1 || event.button === MIDDLE || this.painter.isMoving()
    if (isPan) {
      if (this.drawing !== null) this.painter.cancel()
      this.drawing = null
    } else {
      this.drawing = event.pointerId
      this.painter.begin(this.canvas.locate(event), event.button === RIGHT)
    }
  }

  private move(event: PointerEvent): void {
    this.painter.hover(event.pointerType === 'touch' ? null : this.canvas.locate(event))
    const before = this.pointers.get(event.pointerId)
    if (!before) return
    if (this.drawing === event.pointerId) {
      const events = event.getCoalescedEvents?.() ?? []
      for (const one of events.length ? events : [event]) this.painter.move(this.canvas.locate(one))
    } else this.drag(before, event)
    this.pointers.set(event.pointerId, event)
  }

  private drag(before: PointerEvent, now: PointerEvent): void {
    const other = [...this.pointers.values()].find((one) => one.pointerId !== now.pointerId)
    const share = other ? 0.5 : 1
    this.canvas.pan(share * (now.clientX - before.clientX), share * (now.clientY - before.clientY))
    if (!other) return
    const gap = (one: PointerEvent): number => Math.hypot(one.clientX - other.clientX, one.clientY - other.clientY)
    const about = { x: (now.clientX + other.clientX) / 2, y: (now.clientY + other.clientY) / 2 }
    this.canvas.zoom(Math.max(1, gap(now)) / Math.max(1, gap(before)), about)
  }

  private up(event: PointerEvent): void {
    this.pointers.delete(event.pointerId)
    if (this.drawing === event.pointerId) this.endStroke()
  }

  private endStroke(): void {
    if (this.drawing === null) return
    this.drawing = null
    this.painter.end()
  }
}
