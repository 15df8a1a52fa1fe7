/** visualization_msgs: markers live until they are deleted, each known by namespace and number. */

import { placeOutline } from '../geo.ts'
import type { Vec2 } from '../wire.ts'
import type { Drawing, Look } from './drawing.ts'
import type { Colour, FramePose, Marker, MarkerArray } from './messages.ts'
import { frameOf, placed, within } from './messages.ts'
import type { Setting } from './setting.ts'

const DELETE = 2
const DELETE_ALL = 3

export interface Kept {
  marker: Marker
  frame: FramePose
}
export type Markers = Map<string, Kept>

export function foldMarkers(known: Markers | undefined, message: Marker | MarkerArray, { robot }: Setting): Markers {
  const kept = known ?? new Map<string, Kept>()
  for (const marker of 'markers' in message ? message.markers : [message]) {
    const key = `${marker.ns ?? ''}/${marker.id ?? 0}`
    if (marker.action === DELETE_ALL) kept.clear()
    else if (marker.action === DELETE) kept.delete(key)
    else kept.set(key, { marker, frame: within(frameOf(marker.header, robot), marker.pose) })
  }
  return kept
}

function css(c: Colour | undefined): { color: string; alpha: number } {
  if (!c) return { color: '#b1128a', alpha: 1 }
  const [r, g, b] = [c.r, c.g, c.b].map((value) => Math.round(255 * value))
  return { color: `rgb(${r} ${g} ${b})`, alpha: c.a ?? 1 }
}

type Painter = (kept: Kept, look: Look, draw: Drawing) => void

const points = ({ marker, frame }: Kept): Vec2[] => (marker.points ?? []).map((p) => placed(frame, p))
const scale = ({ marker }: Kept): [number, number] => [marker.scale?.x ?? 1, marker.scale?.y ?? marker.scale?.x ?? 1]
const lookOf = ({ marker }: Kept, i: number, usual: Look): Look =>
  marker.colors?.[i] ? { ...usual, ...css(marker.colors[i]) } : usual

function box(frame: FramePose, [w, h]: [number, number]): Vec2[] {
  return placeOutline(
    [
      [w / 2, h / 2],
      [-w / 2, h / 2],
      [-w / 2, -h / 2],
      [w / 2, -h / 2],
    ],
    ...frame,
  )
}

function round(frame: FramePose, [w, h]: [number, number]): Vec2[] {
  return placeOutline(
    Array.from(
      { length: 24 },
      (_, i): Vec2 => [(w / 2) * Math.cos((i * Math.PI) / 12), (h / 2) * Math.sin((i * Math.PI) / 12)],
    ),
    ...frame,
  )
}

/** The same shape at each of the marker's points. */
function each(shape: typeof box): Painter {
  return (kept, look, draw) =>
    points(kept).forEach(([x, y], i) => draw.polygon(shape([x, y, kept.frame[2]], scale(kept)), lookOf(kept, i, look)))
}

function once(shape: typeof box): Painter {
  return (kept, look, draw) => draw.polygon(shape(kept.frame, scale(kept)), look)
}

const arrow: Painter = (kept, look, draw) => {
  const [from, to] = points(kept)
  if (from && to)
    draw.arrow(from, Math.atan2(to[1] - from[1], to[0] - from[0]), Math.hypot(to[0] - from[0], to[1] - from[1]), look)
  else draw.arrow([kept.frame[0], kept.frame[1]], kept.frame[2], scale(kept)[0], look)
}

function pairs(kept: Kept, size: number, paint: (corners: Vec2[], i: number) => void): void {
  const all = points(kept)
  for (let i = 0; i + size <= all.length; i += size) paint(all.slice(i, i + size), i)
}

/** By the numbers of visualization_msgs/Marker. */
const PAINTERS: Record<number, Painter> = {
  0: arrow,
  1: once(box),
  2: once(round),
  3: once(round),
  4: (kept, look, draw) => draw.line(points(kept), { ...look, width_m: scale(kept)[0] }),
  5: (kept, look, draw) =>
    pairs(kept, 2, (ends, i) => draw.line(ends, { ...lookOf(kept, i, look), width_m: scale(kept)[0] })),
  6: each(box),
  7: each(round),
  8: (kept, look, draw) =>
    points(kept).forEach((p, i) => draw.point(p, { ...lookOf(kept, i, look), radius_m: scale(kept)[0] / 2 })),
  9: (kept, look, draw) => draw.label([kept.frame[0], kept.frame[1]], kept.marker.text ?? '', look),
  10: once(box),
  11: (kept, look, draw) => pairs(kept, 3, (corners, i) => draw.polygon(corners, lookOf(kept, i, look))),
}

export function drawMarkers(markers: Markers, draw: Drawing): void {
  for (const kept of markers.values()) PAINTERS[kept.marker.type]?.(kept, css(kept.marker.color), draw)
}
