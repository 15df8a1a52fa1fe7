/** Displays that are pictures lying on the ground: occupancy grids and textured markers. */

import { placeOutline } from '../geo.ts'
import type { Vec2 } from '../wire.ts'
import type {
  CompressedImage,
  FramePose,
  Image,
  OccupancyGrid,
  OccupancyGridUpdate,
  TexturedMarker,
  TexturedMarkerArray,
} from './messages.ts'
import { bytesOf, frameOf, within } from './messages.ts'
import type { Option } from './options.ts'
import { choice, words } from './options.ts'
import type { Setting } from './setting.ts'
import { say } from '../say.ts'

/** A picture and where its corners lie in the map: upper left, upper right, lower right, lower left. */
export interface Laid {
  image: HTMLCanvasElement
  corners: [Vec2, Vec2, Vec2, Vec2]
}

export const GRID_OPTIONS: Option[] = [choice('scheme', say('colours'), 'map', 'costmap')]

export interface Grid {
  width: number
  height: number
  resolution: number
  frame: FramePose
  cells: Uint8Array
}

export function foldGrid(
  known: Grid | undefined,
  message: OccupancyGrid | OccupancyGridUpdate,
  { robot }: Setting,
): Grid | undefined {
  const data = bytesOf(message.data)
  if ('info' in message) {
    const { width, height, resolution, origin } = message.info
    return { width, height, resolution, frame: within(frameOf(message.header, robot), origin), cells: data }
  }
  if (!known) return known
  for (let row = 0; row < message.height; row++) {
    known.cells.set(
      data.subarray(row * message.width, (row + 1) * message.width),
      (message.y + row) * known.width + message.x,
    )
  }
  return known
}

const UNKNOWN = 255 // -1 as a byte
const MOST = 100

/** The colour of a cell (0 free … 100 occupied, -1 unknown) as red, green, blue, alpha. */
export function cellColour(value: number, scheme: string): [number, number, number, number] {
  if (value === UNKNOWN) return scheme === 'map' ? [112, 137, 134, 160] : [0, 0, 0, 0]
  if (scheme === 'map') return value > MOST ? [0, 180, 0, 255] : [...grey(255 - (255 * value) / MOST), 255]
  if (value === 0) return [0, 0, 0, 0]
  if (value === MOST) return [255, 0, 255, 255]
  if (value === MOST - 1) return [0, 255, 255, 255]
  const warm = (255 * value) / MOST
  return [warm, 0, 255 - warm, 255]
}

function grey(value: number): [number, number, number] {
  return [value, value, value]
}

export function layGrid({ width, height, resolution, frame, cells }: Grid, { options }: Setting): Laid | null {
  const image = pixels(width, height, (i) => {
    const [column, row] = [i % width, height - 1 - Math.floor(i / width)] // row 0 is the lowest
    return cellColour(cells[row * width + column] ?? UNKNOWN, words(options, 'scheme'))
  })
  const [w, h] = [width * resolution, height * resolution]
  return (
    image && {
      image,
      corners: corners(
        [
          [0, h],
          [w, h],
          [w, 0],
          [0, 0],
        ],
        frame,
      ),
    }
  )
}

function corners(outline: Vec2[], frame: FramePose): Laid['corners'] {
  return placeOutline(outline, ...frame) as Laid['corners']
}

function pixels(
  width: number,
  height: number,
  colourOf: (i: number) => readonly [number, number, number, number],
): HTMLCanvasElement | null {
  const canvas = document.createElement('canvas')
  canvas.width = width
  canvas.height = height
  const pen = canvas.getContext('2d')
  if (!pen || !width || !height) return null
  const out = pen.createImageData(width, height)
  for (let i = 0; i < width * height; i++) out.data.set(colourOf(i), 4 * i)
  pen.putImageData(out, 0, 0)
  return canvas
}

const CHANNELS: Record<string, [red: number, green: number, blue: number, step: number]> = {
  rgb8: [0, 1, 2, 3],
  bgr8: [2, 1, 0, 3],
  rgba8: [0, 1, 2, 4],
  bgra8: [2, 1, 0, 4],
  mono8: [0, 0, 0, 1],
  '8UC1': [0, 0, 0, 1],
  '8UC3': [2, 1, 0, 3],
}

/** A raw image as a canvas; null for an encoding that no browser can guess. */
export function canvasOf(image: Image): HTMLCanvasElement | null {
  const data = bytesOf(image.data)
  const channels = CHANNELS[image.encoding]
  if (!channels) return null
  const [r, g, b, size] = channels
  const step = image.step || image.width * size
  return pixels(image.width, image.height, (i) => {
    const at = Math.floor(i / image.width) * step + (i % image.width) * size
    return [data[at + r], data[at + g], data[at + b], 255]
  })
}

/** A raw or compressed image as a canvas. */
export async function decoded(image: Image | CompressedImage): Promise<HTMLCanvasElement | null> {
  if ('encoding' in image) return canvasOf(image)
  const bitmap = await createImageBitmap(new Blob([bytesOf(image.data)])).catch(() => null)
  if (!bitmap) return null
  const canvas = document.createElement('canvas')
  canvas.width = bitmap.width
  canvas.height = bitmap.height
  canvas.getContext('2d')?.drawImage(bitmap, 0, 0)
  bitmap.close()
  return canvas
}

/** A 32-bit float picture of disparities as colours: far is blue, near is red, nothing is clear. */
export function disparityCanvas(image: Image, low: number, high: number): HTMLCanvasElement | null {
  const bytes = bytesOf(image.data)
  const view = new DataView(bytes.buffer)
  const step = image.step || 4 * image.width
  return pixels(image.width, image.height, (i) => {
    const at = Math.floor(i / image.width) * step + 4 * (i % image.width)
    const value = at + 4 <= bytes.length ? view.getFloat32(at, !image.is_bigendian) : NaN
    if (!(value >= low && value <= high)) return [0, 0, 0, 0]
    const share = high > low ? (value - low) / (high - low) : 0
    return [255 * share, 255 * (1 - Math.abs(2 * share - 1)), 255 * (1 - share), 255]
  })
}

/** One picture as it lies; several together as one, north up. */
export async function layTexture(
  message: TexturedMarker | TexturedMarkerArray,
  { robot }: Setting,
): Promise<Laid | null> {
  const markers = 'markers' in message ? message.markers : [message]
  const tiles = await Promise.all(markers.map((marker) => layOne(marker, robot)))
  const found = tiles.filter((tile) => tile !== null)
  return found.length === 1 && (found[0].alpha ?? 1) === 1 ? found[0] : together(found)
}

interface Tile extends Laid {
  pose: FramePose
  resolution: number
  alpha?: number
}

async function layOne(marker: TexturedMarker, robot: FramePose): Promise<Tile | null> {
  const image = await decoded(marker.image)
  if (!image) return null
  const { resolution, alpha } = marker
  const [w, h] = [image.width, image.height].map((size) => (size * resolution) / 2)
  const pose = within(frameOf(marker.header, robot), marker.pose)
  const outline: Vec2[] = [
    [-w, h],
    [w, h],
    [w, -h],
    [-w, -h],
  ]
  return { image, corners: corners(outline, pose), pose, resolution, ...(alpha ? { alpha } : {}) }
}

const MOST_SIDE_PX = 2048

function together(tiles: Tile[]): Laid | null {
  if (!tiles.length) return null
  const [xs, ys] = [0, 1].map((axis) => tiles.flatMap((tile) => tile.corners.map((corner) => corner[axis])))
  const [west, east, south, north] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)]
  const finest = Math.min(...tiles.map(({ resolution }) => resolution))
  const mPerPx = Math.max(finest, (east - west) / MOST_SIDE_PX, (north - south) / MOST_SIDE_PX)
  const canvas = document.createElement('canvas')
  canvas.width = Math.max(1, Math.round((east - west) / mPerPx))
  canvas.height = Math.max(1, Math.round((north - south) / mPerPx))
  const pen = canvas.getContext('2d')
  if (!pen) return null
  for (const { image, pose, resolution, alpha } of tiles) {
    pen.save()
    pen.globalAlpha = alpha ?? 1
    pen.translate((pose[0] - west) / mPerPx, (north - pose[1]) / mPerPx)
    pen.rotate(-pose[2])
    pen.scale(resolution / mPerPx, resolution / mPerPx)
    pen.drawImage(image, -image.width / 2, -image.height / 2)
    pen.restore()
  }
  const outline: Vec2[] = [
    [west, north],
    [east, north],
    [east, south],
    [west, south],
  ]
  return { image: canvas, corners: corners(outline, [0, 0, 0]) }
}
