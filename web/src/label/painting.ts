/** Classes of a picture as an array of bytes, and what a person does to them; no browser needed. */

import { say } from '../say.ts'

export interface Kind {
  id: number
  name: string
  key: string
  rgb: [number, number, number]
}

export const WEED = 0
export const CROP = 1
export const SOIL = 2
export const IGNORED = 255
/** In the order of their keys; the ids are those of the masks. */
export const KINDS: Kind[] = [
  { id: CROP, name: say('crop'), key: '1', rgb: [52, 200, 95] },
  { id: WEED, name: say('weed'), key: '2', rgb: [255, 45, 70] },
  { id: SOIL, name: say('soil'), key: '3', rgb: [150, 110, 70] },
  { id: IGNORED, name: say('kindIgnore'), key: '4', rgb: [120, 110, 255] },
]

export interface Raster<T extends Uint8Array | Uint16Array> {
  width: number
  height: number
  data: T
}
export type Classes = Raster<Uint8Array>
export type Pieces = Raster<Uint16Array>

/** From the first row and column to before the last ones. */
export interface Box {
  left: number
  top: number
  right: number
  bottom: number
}

export interface Point {
  x: number
  y: number
}

export function join(a: Box | null, b: Box): Box {
  if (!a) return b
  return {
    left: Math.min(a.left, b.left),
    top: Math.min(a.top, b.top),
    right: Math.max(a.right, b.right),
    bottom: Math.max(a.bottom, b.bottom),
  }
}

function clip(box: Box, within: Raster<Uint8Array | Uint16Array>): Box {
  return {
    left: Math.max(0, Math.floor(box.left)),
    top: Math.max(0, Math.floor(box.top)),
    right: Math.min(within.width, Math.ceil(box.right)),
    bottom: Math.min(within.height, Math.ceil(box.bottom)),
  }
}

/** Paints the pixels whose centres lie within `radius` of the line from `a` to `b`, of the classes `isPainted`. */
export function stroke(
  classes: Classes,
  a: Point,
  b: Point,
  radius: number,
  kind: number,
  isPainted: (kind: number) => boolean = () => true,
): Box {
  const box = clip(
    {
      left: Math.min(a.x, b.x) - radius,
      top: Math.min(a.y, b.y) - radius,
      right: Math.max(a.x, b.x) + radius + 1,
      bottom: Math.max(a.y, b.y) + radius + 1,
    },
    classes,
  )
  const [dx, dy] = [b.x - a.x, b.y - a.y]
  const length2 = dx * dx + dy * dy
  const limit2 = Math.max(radius, 0.5) ** 2
  for (let y = box.top; y < box.bottom; y++) {
    for (let x = box.left; x < box.right; x++) {
      const [px, py] = [x + 0.5 - a.x, y + 0.5 - a.y]
      const along = length2 > 0 ? Math.min(1, Math.max(0, (px * dx + py * dy) / length2)) : 0
      if ((px - along * dx) ** 2 + (py - along * dy) ** 2 > limit2) continue
      const i = y * classes.width + x
      if (isPainted(classes.data[i] as number)) classes.data[i] = kind
    }
  }
  return box
}

/** Paints the superpixel at a point; null outside the picture. */
export function fill(classes: Classes, pieces: Pieces, at: Point, kind: number): Box | null {
  const [sx, sy] = [pieces.width / classes.width, pieces.height / classes.height]
  const [u, v] = [Math.floor(at.x * sx), Math.floor(at.y * sy)]
  if (u < 0 || v < 0 || u >= pieces.width || v >= pieces.height) return null
  const number = pieces.data[v * pieces.width + u] as number
  const found = boxOf(pieces, number)
  const box = clip(
    { left: found.left / sx, top: found.top / sy, right: found.right / sx, bottom: found.bottom / sy },
    classes,
  )
  for (let y = box.top; y < box.bottom; y++) {
    const row = Math.floor((y + 0.5) * sy) * pieces.width
    for (let x = box.left; x < box.right; x++) {
      if (pieces.data[row + Math.floor((x + 0.5) * sx)] === number) classes.data[y * classes.width + x] = kind
    }
  }
  return box
}

function boxOf(pieces: Pieces, number: number): Box {
  let box: Box | null = null
  for (let i = pieces.data.indexOf(number); i >= 0; i = pieces.data.indexOf(number, i + 1)) {
    const [x, y] = [i % pieces.width, Math.floor(i / pieces.width)]
    box = join(box, { left: x, top: y, right: x + 1, bottom: y + 1 })
  }
  return box ?? { left: 0, top: 0, right: 0, bottom: 0 }
}

interface Step {
  box: Box
  before: Uint8Array
}

const STEPS_KEPT = 100

/** Undo and redo, a stroke at a time. */
export class History {
  private undone: Step[] = []
  private done: Step[] = []
  private start: Uint8Array | null = null
  private box: Box | null = null

  get canUndo(): boolean {
    return this.done.length > 0
  }

  get canRedo(): boolean {
    return this.undone.length > 0
  }

  begin(classes: Classes): void {
    this.start = classes.data.slice()
    this.box = null
  }

  touch(box: Box): void {
    this.box = join(this.box, box)
  }

  /** Ends a stroke; whether it changed anything. */
  end(classes: Classes): boolean {
    const { start, box } = this
    this.start = null
    if (!start || !box) return false
    const before = cut({ ...classes, data: start }, box)
    if (before.every((value, i) => value === cutAt(classes, box, i))) return false
    this.done.push({ box, before })
    if (this.done.length > STEPS_KEPT) this.done.shift()
    this.undone = []
    return true
  }

  undo(classes: Classes): Box | null {
    return swap(classes, this.done, this.undone)
  }

  redo(classes: Classes): Box | null {
    return swap(classes, this.undone, this.done)
  }
}

function swap(classes: Classes, from: Step[], to: Step[]): Box | null {
  const step = from.pop()
  if (!step) return null
  to.push({ box: step.box, before: cut(classes, step.box) })
  const width = step.box.right - step.box.left
  for (let y = step.box.top; y < step.box.bottom; y++) {
    const row = step.before.subarray((y - step.box.top) * width, (y - step.box.top + 1) * width)
    classes.data.set(row, y * classes.width + step.box.left)
  }
  return step.box
}

function cut(classes: Classes, box: Box): Uint8Array {
  const width = box.right - box.left
  const part = new Uint8Array(width * (box.bottom - box.top))
  for (let y = box.top; y < box.bottom; y++) {
    const start = y * classes.width + box.left
    part.set(classes.data.subarray(start, start + width), (y - box.top) * width)
  }
  return part
}

function cutAt(classes: Classes, box: Box, i: number): number {
  const width = box.right - box.left
  return classes.data[(box.top + Math.floor(i / width)) * classes.width + box.left + (i % width)] as number
}

const FILL_ALPHA = 130

/** Colours (red, green, blue, alpha) of a part of the classes: plants tinted, their outlines full. */
export function tint(classes: Classes, box: Box): Uint8ClampedArray<ArrayBuffer> {
  const width = box.right - box.left
  const pixels = new Uint8ClampedArray(4 * width * (box.bottom - box.top))
  const colours = new Map(KINDS.map((kind) => [kind.id, kind.rgb]))
  for (let y = box.top; y < box.bottom; y++) {
    for (let x = box.left; x < box.right; x++) {
      const kind = classes.data[y * classes.width + x] as number
      const rgb = colours.get(kind)
      if (kind === SOIL || !rgb) continue
      const alpha = isEdge(classes, x, y, kind) ? 255 : FILL_ALPHA
      pixels.set([...rgb, alpha], 4 * ((y - box.top) * width + x - box.left))
    }
  }
  return pixels
}

function isEdge({ width, height, data }: Classes, x: number, y: number, kind: number): boolean {
  const i = y * width + x
  return (
    (x > 0 && data[i - 1] !== kind) ||
    (x + 1 < width && data[i + 1] !== kind) ||
    (y > 0 && data[i - width] !== kind) ||
    (y + 1 < height && data[i + width] !== kind)
  )
}
