/** The picture with its classes over it: zoom, pan, and where on the picture a pointer is. */

import { el } from '../dom.ts'
import { type Box, type Classes, type Pieces, type Point, tint } from './painting.ts'
import { say } from '../say.ts'

const LARGEST_SCALE = 24
const FILLED = 0.96
/** Of the scale at which the whole picture is seen. */
const SMALLEST_SHARE = 0.3

export class LabelCanvas {
  readonly node: HTMLElement
  private readonly stage = el('div', { class: 'stage' })
  private readonly photo = el('canvas', { class: 'photo' })
  private readonly outlines = el('canvas', { class: 'outlines', hidden: true })
  private readonly overlay = el('canvas', { class: 'overlay' })
  private readonly cursor = el('div', { class: 'brush-cursor', hidden: true })
  private origin: Point = { x: 0, y: 0 }
  private isFitted = true
  scale = 1

  constructor() {
    this.stage.append(this.photo, this.outlines, this.overlay)
    this.node = el('div', { class: 'canvas', tabindex: 0, role: 'img', 'aria-label': say('pictureWithItsClasses') })
    this.node.append(this.stage, this.cursor)
    new ResizeObserver(() => this.isFitted && this.fit()).observe(this.node)
  }

  show(picture: ImageBitmap, classes: Classes): void {
    for (const canvas of [this.photo, this.overlay]) {
      canvas.width = picture.width
      canvas.height = picture.height
    }
    this.photo.getContext('2d')?.drawImage(picture, 0, 0)
    this.outlines.hidden = true
    this.stage.style.width = `${picture.width}px`
    this.stage.style.height = `${picture.height}px`
    this.draw(classes)
    this.fit()
  }

  /** Shows no picture. */
  clear(): void {
    for (const canvas of [this.photo, this.overlay]) canvas.width = canvas.height = 0
    this.outlines.hidden = true
    this.stage.style.width = this.stage.style.height = '0'
  }

  /** Draws the classes anew, or a part of them with the outlines beside it. */
  draw(classes: Classes, part?: Box): void {
    const { width, height } = classes
    const box = {
      left: Math.max(0, (part?.left ?? 0) - 1),
      top: Math.max(0, (part?.top ?? 0) - 1),
      right: Math.min(width, (part?.right ?? width) + 1),
      bottom: Math.min(height, (part?.bottom ?? height) + 1),
    }
    if (box.right <= box.left || box.bottom <= box.top) return
    const pixels = new ImageData(tint(classes, box), box.right - box.left, box.bottom - box.top)
    this.overlay.getContext('2d')?.putImageData(pixels, box.left, box.top)
  }

  /** Draws the borders of the superpixels; null hides them. */
  showPieces(pieces: Pieces | null): void {
    this.outlines.hidden = !pieces
    if (!pieces) return
    const { width, height, data } = pieces
    this.outlines.width = width
    this.outlines.height = height
    const pixels = new ImageData(width, height)
    for (let i = 0; i < data.length; i++) {
      const isBorder = ((i + 1) % width !== 0 && data[i] !== data[i + 1]) || data[i] !== (data[i + width] ?? data[i])
      if (isBorder) pixels.data.set([255, 255, 255, 70], 4 * i)
    }
    this.outlines.getContext('2d')?.putImageData(pixels, 0, 0)
  }

  setOpacity(share: number): void {
    this.overlay.style.opacity = String(share)
  }

  fit(): void {
    const { clientWidth, clientHeight } = this.node
    if (!clientWidth || !clientHeight || !this.photo.width) return
    this.scale = this.fitted()
    this.origin = {
      x: (clientWidth - this.scale * this.photo.width) / 2,
      y: (clientHeight - this.scale * this.photo.height) / 2,
    }
    this.isFitted = true
    this.place()
  }

  /** The scale at which the whole picture is seen. */
  private fitted(): number {
    const { clientWidth, clientHeight } = this.node
    return FILLED * Math.min(clientWidth / Math.max(1, this.photo.width), clientHeight / Math.max(1, this.photo.height))
  }

  zoom(factor: number, about?: Point): void {
    const box = this.node.getBoundingClientRect()
    const at = about ?? { x: box.left + box.width / 2, y: box.top + box.height / 2 }
    const [x, y] = [at.x - box.left, at.y - box.top]
    const fitted = this.fitted()
    const next = Math.min(Math.max(LARGEST_SCALE, fitted), Math.max(SMALLEST_SHARE * fitted, this.scale * factor))
    const ratio = next / this.scale
    this.origin = { x: x - ratio * (x - this.origin.x), y: y - ratio * (y - this.origin.y) }
    this.scale = next
    this.isFitted = false
    this.place()
  }

  pan(dx: number, dy: number): void {
    this.origin = { x: this.origin.x + dx, y: this.origin.y + dy }
    this.isFitted = false
    this.place()
  }

  /** Where on the picture a pointer is, in its pixels. */
  locate(event: { clientX: number; clientY: number }): Point {
    const box = this.node.getBoundingClientRect()
    return {
      x: (event.clientX - box.left - this.origin.x) / this.scale,
      y: (event.clientY - box.top - this.origin.y) / this.scale,
    }
  }

  /** Shows how large the brush is where the pointer is; null hides it. */
  showCursor(at: Point | null, radius: number): void {
    this.cursor.hidden = !at
    if (!at) return
    const size = 2 * radius * this.scale
    this.cursor.style.width = this.cursor.style.height = `${size}px`
    const [x, y] = [this.origin.x + at.x * this.scale, this.origin.y + at.y * this.scale]
    this.cursor.style.transform = `translate(${x - size / 2}px, ${y - size / 2}px)`
  }

  private place(): void {
    this.stage.style.transform = `translate(${this.origin.x}px, ${this.origin.y}px) scale(${this.scale})`
    this.stage.classList.toggle('pixels', this.scale > 2)
  }
}
