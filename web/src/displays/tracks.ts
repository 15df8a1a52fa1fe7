/** Displays of where something is and was: fixes, poses, odometry, frames, paths and routes. */

import type { Vec2 } from '../wire.ts'
import type { Drawing } from './drawing.ts'
import type {
  FramePose,
  GpsFix,
  NavSatFix,
  Odometry,
  PoseStamped,
  RosPath,
  Route,
  TransformStamped,
} from './messages.ts'
import { frameOf, placed, within } from './messages.ts'
import type { Option, Options } from './options.ts'
import { amount, choice, colour, flag, number, words } from './options.ts'
import type { Setting } from './setting.ts'
import { fixed } from '../format.ts'
import { say } from '../say.ts'

const SIGMAS_95 = 2.4477

/** One kept place: heading where known, covariance (xx, xy, yy) where known. */
export interface Place {
  p: Vec2
  yaw: number | null
  cov: [number, number, number] | null
  t: number | null
}

export const TRACK_OPTIONS: Option[] = [
  choice('style', say('drawAs'), 'lines', 'points', 'arrows'),
  colour('#1f5fe0'),
  number('size', say('size'), 3, 1, 20, 1, 'px'),
  number('buffer', say('placesKept'), 2000, 1, 20000, 1),
  number('tolerance_m', say('nearestTwoPlaces'), 0.05, 0, 10, 0.01, 'm'),
]
export const ODOMETRY_OPTIONS: Option[] = [
  ...TRACK_OPTIONS,
  flag('covariance', say('covarianceEllipse'), true),
  flag('all_covariances', say('ellipseOfEveryPlace'), false),
  flag('timestamps', say('times'), false),
  flag('laps', say('aColourForEachLap'), false),
]
const LAP_COLOURS = ['#1f5fe0', '#c2410c', '#14803c', '#8b2fc9', '#b0125b', '#0b7285']

type Track = Place[] | undefined

/** Adds a place to a track: not nearer than the tolerance, not more than the buffer. */
export function extended(track: Track, place: Place, options: Options): Place[] {
  const kept = track ?? []
  const last = kept[kept.length - 1]
  if (last && Math.hypot(place.p[0] - last.p[0], place.p[1] - last.p[1]) < amount(options, 'tolerance_m')) return kept
  kept.push(place)
  const most = amount(options, 'buffer')
  if (kept.length > most) kept.splice(0, kept.length - most)
  return kept
}

function covarianceOf(values: number[] | undefined, size: 3 | 6): Place['cov'] {
  return values && values.length >= size + 2 && Number(values[0]) > 0 ? [values[0], values[1], values[size + 1]] : null
}

function seconds(header: { stamp?: { sec: number; nanosec: number } } | undefined): number | null {
  return header?.stamp ? header.stamp.sec + header.stamp.nanosec * 1e-9 : null
}

const COMPASS = Math.PI / 2

export function foldFix(track: Track, fix: NavSatFix & GpsFix, { options, projection }: Setting): Place[] {
  const yaw = fix.track === undefined ? null : COMPASS - (fix.track * Math.PI) / 180
  return extended(
    track,
    {
      p: projection.toMap(fix.longitude, fix.latitude),
      yaw,
      cov: covarianceOf(fix.position_covariance, 3),
      t: seconds(fix.header),
    },
    options,
  )
}

export function foldPose(track: Track, message: PoseStamped, { options, robot }: Setting): Place[] {
  const [x, y, yaw] = within(frameOf(message.header, robot), message.pose)
  return extended(track, { p: [x, y], yaw, cov: null, t: seconds(message.header) }, options)
}

export function foldOdometry(track: Track, message: Odometry, { options, robot }: Setting): Place[] {
  const [x, y, yaw] = within(frameOf(message.header, robot), message.pose.pose)
  return extended(
    track,
    { p: [x, y], yaw, cov: covarianceOf(message.pose.covariance, 6), t: seconds(message.header) },
    options,
  )
}

export function drawTrack(track: Place[], draw: Drawing, { options }: Setting): void {
  const color = words(options, 'color')
  const size = amount(options, 'size')
  const style = words(options, 'style')
  if (style === 'lines') drawLaps(track, draw, options)
  else for (const place of track) drawPlace(place, draw, options)
  const last = track[track.length - 1]
  if (!last) return
  if (style === 'lines') draw.point(last.p, { color, radius: size + 2 })
  if (options.covariance) drawEllipses(options.all_covariances ? track : [last], draw, color)
  if (options.timestamps && last.t !== null) draw.label(last.p, fixed(last.t, 1, 's'))
}

function drawLaps(track: Place[], draw: Drawing, options: Options): void {
  for (const lap of options.laps ? laps(track) : [track]) {
    const color = lap === track ? words(options, 'color') : lapColour(track, lap)
    draw.line(
      lap.map((place) => place.p),
      { color, width: amount(options, 'size') },
    )
  }
}

function drawPlace(place: Place, draw: Drawing, options: Options): void {
  const color = words(options, 'color')
  const size = amount(options, 'size')
  if (words(options, 'style') === 'arrows' && place.yaw !== null) draw.arrow(place.p, place.yaw, 0.12 * size, { color })
  else draw.point(place.p, { color, radius: size })
}

function drawEllipses(places: Place[], draw: Drawing, color: string): void {
  for (const { p, cov } of places) if (cov) draw.ellipse(p, cov, SIGMAS_95, { color, fill: 0.25 })
}

const LAP_M = 1

/** Pieces of a track, cut each time that it comes back to its beginning. */
export function laps(track: Place[]): Place[][] {
  if (!track.length) return []
  const [x, y] = track[0].p
  const pieces: Place[][] = [[]]
  let away = false
  for (const place of track) {
    const near = Math.hypot(place.p[0] - x, place.p[1] - y) < LAP_M
    pieces[pieces.length - 1].push(place)
    if (near && away) pieces.push([place])
    away = away ? !near : Math.hypot(place.p[0] - x, place.p[1] - y) > 2 * LAP_M
  }
  return pieces
}

function lapColour(track: Place[], lap: Place[]): string {
  return LAP_COLOURS[laps(track).findIndex((piece) => piece[0] === lap[0]) % LAP_COLOURS.length] ?? LAP_COLOURS[0]
}

export const PATH_OPTIONS: Option[] = [
  colour('#6a6f1d'),
  number('size', say('width'), 3, 1, 20, 1, 'px'),
  choice('style', say('drawAs'), 'lines', 'points'),
]

export function drawPath(path: RosPath, draw: Drawing, setting: Setting): void {
  const frame = frameOf(path.header, setting.robot)
  drawPoints(
    path.poses.map(({ pose }) => placed(frame, pose.position)),
    draw,
    setting.options,
  )
}

function drawPoints(points: Vec2[], draw: Drawing, options: Options): void {
  const look = { color: words(options, 'color'), width: amount(options, 'size'), radius: amount(options, 'size') }
  if (words(options, 'style') === 'lines') draw.line(points, look)
  else for (const p of points) draw.point(p, look)
}

/** The route, and an arrow where on it the robot is. */
export function drawRoute(route: Route, draw: Drawing, setting: Setting): void {
  const frame = frameOf(route.header, setting.robot)
  const points = route.route_points.map(({ pose }) => placed(frame, pose.position))
  drawPoints(points, draw, setting.options)
  const here = route.position_m === undefined ? null : along(points, route.position_m)
  if (here) draw.arrow([here[0], here[1]], here[2], 1, { color: words(setting.options, 'icon') })
}

/** The place and heading at a distance along a polyline; null for a line without length. */
export function along(points: Vec2[], distanceM: number): FramePose | null {
  let left = distanceM
  for (let i = 1; i < points.length; i++) {
    const [dx, dy] = [points[i][0] - points[i - 1][0], points[i][1] - points[i - 1][1]]
    const length = Math.hypot(dx, dy)
    if (left <= length || i === points.length - 1) {
      const share = length ? Math.min(1, left / length) : 0
      return [points[i - 1][0] + share * dx, points[i - 1][1] + share * dy, Math.atan2(dy, dx)]
    }
    left -= length
  }
  return null
}

export const FRAME_OPTIONS: Option[] = [
  ...TRACK_OPTIONS.slice(1),
  number('axis_m', say('lengthOfTheAxes'), 1, 0.1, 10, 0.1, 'm'),
  choice('style', say('drawAs'), 'axes', 'lines'),
]

export function foldFrame(track: Track, message: TransformStamped, { options, robot }: Setting): Place[] {
  const { translation, rotation } = message.transform
  const [x, y, yaw] = within(frameOf(message.header, robot), { position: translation, orientation: rotation })
  const place: Place = { p: [x, y], yaw, cov: null, t: null }
  const kept = extended(track, place, options)
  kept[kept.length - 1] = place // the axes turn on the spot too
  return kept
}

export function drawFrame(track: Place[], draw: Drawing, setting: Setting): void {
  const { options } = setting
  const last = track[track.length - 1]
  if (words(options, 'style') === 'lines') drawTrack(track, draw, setting)
  else if (last) {
    const length = amount(options, 'axis_m')
    draw.arrow(last.p, last.yaw ?? 0, length, { color: '#d22f26' })
    draw.arrow(last.p, (last.yaw ?? 0) + COMPASS, length, { color: '#17923f' })
  }
}
