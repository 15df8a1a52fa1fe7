/** Displays of measured points: laser scans and point clouds. */

import type { Vec2 } from '../wire.ts'
import type { Drawing } from './drawing.ts'
import type { LaserScan, PointCloud2, PointField } from './messages.ts'
import { bytesOf, placer } from './messages.ts'
import type { Option } from './options.ts'
import { amount, choice, colour, flag, number, words } from './options.ts'
import type { Setting } from './setting.ts'
import { say } from '../say.ts'

const MOST_POINTS = 20_000

interface Spot {
  p: Vec2
  color: string
}

export const SCAN_OPTIONS: Option[] = [
  choice('by', say('colourBy'), 'range', 'x', 'y', 'intensity', 'one colour'),
  colour('#b1128a'),
  flag('rainbow', say('rainbow'), true),
  ...range(0, 20),
  number('size', say('pointSize'), 3, 1, 20, 1, 'px'),
  number('buffer', say('scansKept'), 1, 1, 50, 1),
]
export const CLOUD_OPTIONS: Option[] = [
  { name: 'by', label: say('colourByField'), value: 'z' },
  colour('#b1128a'),
  flag('rainbow', say('rainbow'), true),
  flag('auto', say('rangeFromTheData'), true),
  ...range(0, 2),
  number('size', say('pointSize'), 3, 1, 20, 1, 'px'),
  number('buffer', say('cloudsKept'), 1, 1, 20, 1),
]

function range(low: number, high: number): Option[] {
  return [
    number('low', say('rangeFrom'), low, -1000, 1000, 0.1),
    number('high', say('rangeTo'), high, -1000, 1000, 0.1),
  ]
}

/** A share in [0, 1] as red (0) through green to violet (1), or as a shade of one colour. */
export function ramp(share: number, rainbow: boolean, color: string): string {
  const s = Math.max(0, Math.min(1, share))
  return rainbow
    ? `hsl(${Math.round(280 * s)} 90% 42%)`
    : `color-mix(in srgb, ${color} ${Math.round(30 + 70 * s)}%, white)`
}

function coloured(value: number, setting: Setting, [low, high]: [number, number]): string {
  const { options } = setting
  return mixed(ramp(high > low ? (value - low) / (high - low) : 0, options.rainbow === true, words(options, 'color')))
}

/** MapLibre reads hsl() but not color-mix(). */
function mixed(color: string): string {
  const found = /^color-mix\(in srgb, #(\w{6}) (\d+)%, white\)$/.exec(color)
  if (!found) return color
  const share = Number(found[2]) / 100
  const parts = [0, 2, 4].map((i) => Math.round(255 + share * (parseInt(found[1].slice(i, i + 2), 16) - 255)))
  return `rgb(${parts.join(' ')})`
}

function kept<T>(batches: T[] | undefined, batch: T, setting: Setting): T[] {
  return [...(batches ?? []), batch].slice(-amount(setting.options, 'buffer'))
}

export function foldScan(scans: Spot[][] | undefined, scan: LaserScan, setting: Setting): Spot[][] {
  const { options, robot } = setting
  const place = placer(scan.header, robot)
  const by = words(options, 'by')
  const limits: [number, number] = [amount(options, 'low'), amount(options, 'high')]
  const spots = scan.ranges.flatMap((distance, i): Spot[] => {
    if (distance === null || !(distance >= scan.range_min && distance <= scan.range_max)) return []
    const angle = scan.angle_min + i * scan.angle_increment
    const [x, y] = [distance * Math.cos(angle), distance * Math.sin(angle)]
    const value = { range: distance, x, y, intensity: scan.intensities?.[i] ?? 0 }[by]
    return [
      {
        p: place({ x, y }),
        color: value === undefined ? words(options, 'color') : coloured(value, setting, limits),
      },
    ]
  })
  return kept(scans, spots, setting)
}

const READERS: Record<number, [bytes: number, read: (view: DataView, at: number, little: boolean) => number]> = {
  1: [1, (view, at) => view.getInt8(at)],
  2: [1, (view, at) => view.getUint8(at)],
  3: [2, (view, at, little) => view.getInt16(at, little)],
  4: [2, (view, at, little) => view.getUint16(at, little)],
  5: [4, (view, at, little) => view.getInt32(at, little)],
  6: [4, (view, at, little) => view.getUint32(at, little)],
  7: [4, (view, at, little) => view.getFloat32(at, little)],
  8: [8, (view, at, little) => view.getFloat64(at, little)],
}

/** One field of every point of a cloud; null where the cloud has no such field. */
export function fieldOf(cloud: PointCloud2, name: string): number[] | null {
  const field: PointField | undefined = cloud.fields.find((f) => f.name === name)
  const reader = field && READERS[field.datatype]
  if (!field || !reader) return null
  const bytes = bytesOf(cloud.data)
  const view = new DataView(bytes.buffer)
  const count = Math.min(
    cloud.width * cloud.height,
    Math.floor((bytes.length - field.offset - reader[0]) / cloud.point_step) + 1,
  )
  return Array.from({ length: Math.max(0, count) }, (_, i) =>
    reader[1](view, i * cloud.point_step + field.offset, !cloud.is_bigendian),
  )
}

export function foldCloud(clouds: Spot[][] | undefined, cloud: PointCloud2, setting: Setting): Spot[][] {
  const { options } = setting
  const [xs, ys, zs] = ['x', 'y', 'z'].map((name) => fieldOf(cloud, name) ?? [])
  const by = words(options, 'by')
  const packed =
    by === 'rgb'
      ? fieldOf({ ...cloud, fields: cloud.fields.map((f) => (f.name === 'rgb' ? { ...f, datatype: 6 } : f)) }, 'rgb')
      : null
  const values = packed ? null : fieldOf(cloud, by)
  const finite = (values ?? []).filter(Number.isFinite)
  const limits: [number, number] = options.auto
    ? finite.reduce<[number, number]>(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity])
    : [amount(options, 'low'), amount(options, 'high')]
  const place = placer(cloud.header, setting.robot)
  const step = Math.ceil(xs.length / MOST_POINTS)
  const spots: Spot[] = []
  for (let i = 0; i < Math.min(xs.length, ys.length); i += step) {
    if (!Number.isFinite(xs[i] + ys[i])) continue
    const color = packed
      ? `#${(packed[i] & 0xffffff).toString(16).padStart(6, '0')}`
      : values
        ? coloured(values[i], setting, limits)
        : words(options, 'color')
    spots.push({ p: place({ x: xs[i], y: ys[i], z: zs[i] ?? 0 }), color })
  }
  return kept(clouds, spots, setting)
}

export function drawSpots(batches: Spot[][], draw: Drawing, { options }: Setting): void {
  for (const spots of batches)
    for (const { p, color } of spots) draw.point(p, { color, radius: amount(options, 'size') })
}
