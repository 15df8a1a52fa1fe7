/** Whole plants of a picture, each named at once; what is soil stays soil. */

import { type Box, type Classes, CROP, join, type Pieces, type Point, WEED } from './painting.ts'

/** Whether a class is that of vegetation with a name. */
export const isVegetation = (kind: number): boolean => kind === WEED || kind === CROP

/** Names the plants from `from` to `to`; `plants` are those of the network, 0 where it knows none. */
export function namePlants(classes: Classes, plants: Pieces, from: Point, to: Point, kind: number): Box | null {
  const steps = Math.max(1, Math.ceil(Math.hypot(to.x - from.x, to.y - from.y)))
  let box: Box | null = null
  for (let i = 0; i <= steps; i++) {
    const at = { x: from.x + (i / steps) * (to.x - from.x), y: from.y + (i / steps) * (to.y - from.y) }
    const isNew = i === 0 || classes.data[indexOf(classes, at)] !== kind
    const named = isNew ? namePlant(classes, plants, at, kind) : null
    if (named) box = join(box, named)
  }
  return box
}

/** Names the plant at a point: the vegetation of its number, or the connected vegetation without one. */
export function namePlant(classes: Classes, plants: Pieces, at: Point, kind: number): Box | null {
  const start = indexOf(classes, at)
  if (start < 0 || !isVegetation(classes.data[start] as number)) return null
  const number = plants.data[start] as number
  const isOfPlant = (i: number): boolean => plants.data[i] === number && isVegetation(classes.data[i] as number)
  const found = number ? findAll(classes, isOfPlant) : findConnected(classes, start, isOfPlant)
  return paintAll(classes, found, kind)
}

/** Gives all pixels of one class another one. */
export function renameAll(classes: Classes, from: number, to: number): Box | null {
  const found = findAll(classes, (i) => classes.data[i] === from)
  return found.length ? paintAll(classes, found, to) : null
}

function indexOf({ width, height }: Classes, { x, y }: Point): number {
  const [u, v] = [Math.floor(x), Math.floor(y)]
  return u < 0 || v < 0 || u >= width || v >= height ? -1 : v * width + u
}

function findAll({ data }: Classes, isTaken: (i: number) => boolean): number[] {
  const found: number[] = []
  for (let i = 0; i < data.length; i++) if (isTaken(i)) found.push(i)
  return found
}

/** Finds the pixels that touch the first one, corners included, over pixels of the same plant. */
function findConnected(classes: Classes, start: number, isTaken: (i: number) => boolean): number[] {
  const isSeen = new Uint8Array(classes.data.length)
  const found = [start]
  isSeen[start] = 1
  for (let next = 0; next < found.length; next++) {
    for (const i of neighbours(classes, found[next] as number)) {
      if (isSeen[i] || !isTaken(i)) continue
      isSeen[i] = 1
      found.push(i)
    }
  }
  return found
}

function neighbours({ width, height }: Classes, i: number): number[] {
  const [x, y] = [i % width, Math.floor(i / width)]
  const found: number[] = []
  for (let v = Math.max(0, y - 1); v <= Math.min(height - 1, y + 1); v++) {
    for (let u = Math.max(0, x - 1); u <= Math.min(width - 1, x + 1); u++) found.push(v * width + u)
  }
  return found
}

function paintAll(classes: Classes, pixels: number[], kind: number): Box {
  let [left, top, right, bottom] = [classes.width, classes.height, 0, 0]
  for (const i of pixels) {
    const [x, y] = [i % classes.width, Math.floor(i / classes.width)]
    classes.data[i] = kind
    left = Math.min(left, x)
    top = Math.min(top, y)
    right = Math.max(right, x + 1)
    bottom = Math.max(bottom, y + 1)
  }
  return { left, top, right, bottom }
}
