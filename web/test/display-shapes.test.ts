import assert from 'node:assert/strict'
import { test } from 'node:test'
import type { Feature } from 'geojson'
import { Drawing } from '../src/displays/drawing.ts'
import { ofYaw } from '../src/displays/messages.ts'
import { filled } from '../src/displays/options.ts'
import type { Options } from '../src/displays/options.ts'
import type { Setting } from '../src/displays/setting.ts'
import { typeOf } from '../src/displays/types.ts'
import { Projection } from '../src/geo.ts'
import type { Vec2 } from '../src/wire.ts'

const projection = new Projection({ lat_deg: 50, lon_deg: 8 })
const MAP = { frame_id: 'map' }
const ORANGE = { r: 1, g: 0.5, b: 0, a: 1 }
const POINT_PX_M = 0.1

/** What a display draws of a message, in the map; the robot stands at (10, 5) and looks north. */
function drawn(type: string, message: unknown, options: Options = {}): Drawn[] {
  const known = typeOf(type)
  assert.ok(known?.kind === 'shapes')
  const setting: Setting = { options: filled(known.options, options), robot: [10, 5, Math.PI / 2], projection }
  const drawing = new Drawing(projection)
  const state = known.fold ? known.fold(undefined as never, message as never, setting) : message
  if (state !== undefined || known.needsNoSource) known.draw(state as never, drawing, setting)
  return drawing.features.map(toDrawn)
}

interface Drawn {
  kind: string
  color: string
  label: string
  points: Vec2[]
}

function toDrawn({ geometry, properties }: Feature): Drawn {
  const places =
    geometry.type === 'Point'
      ? [geometry.coordinates]
      : geometry.type === 'LineString'
        ? geometry.coordinates
        : geometry.type === 'Polygon'
          ? geometry.coordinates[0]
          : []
  const points = places.map(([lon, lat]) => projection.toMap(lon, lat))
  return { kind: geometry.type, color: properties?.color, label: properties?.label, points }
}

/** The shapes that cover a place: an area around it, a line or a point at it. */
function at(shapes: Drawn[], x: number, y: number): Drawn[] {
  return shapes.filter(({ kind, points }) => (kind === 'Polygon' ? isInside(points, x, y) : isAt(points, x, y)))
}

function isAt(points: Vec2[], x: number, y: number): boolean {
  return points.some(([px, py], i) => {
    const [qx, qy] = points[i + 1] ?? [px, py]
    const square = (qx - px) ** 2 + (qy - py) ** 2
    const share = square ? Math.max(0, Math.min(1, ((x - px) * (qx - px) + (y - py) * (qy - py)) / square)) : 0
    return Math.hypot(px + share * (qx - px) - x, py + share * (qy - py) - y) < POINT_PX_M
  })
}

function isInside(ring: Vec2[], x: number, y: number): boolean {
  let inside = false
  for (let i = 1; i < ring.length; i++) {
    const [[ax, ay], [bx, by]] = [ring[i - 1], ring[i]]
    if (ay > y !== by > y && x < ax + ((y - ay) / (by - ay)) * (bx - ax)) inside = !inside
  }
  return inside
}

const pose = (x: number, y: number, yaw = 0) => ({ position: { x, y, z: 0 }, orientation: ofYaw(yaw) })

test('fixes are arrows along their track, or points', () => {
  const [longitude, latitude] = projection.toLonLat(0, -7)
  const arrow = drawn('gps', { longitude, latitude, track: 90 }, { style: 'arrows', color: '#c40000', size: 10 })
  assert.deepEqual(
    at(arrow, 0.8, -7).map(({ kind, color }) => [kind, color]),
    [['Polygon', '#c40000']],
  )
  assert.deepEqual(at(arrow, -0.8, -7), [])
  const point = at(drawn('navsat', { longitude, latitude }, { style: 'points', color: '#008000' }), 0, -7)
  assert.deepEqual([point[0].kind, point[0].color], ['Point', '#008000'])
})

test('a grid has its cells where it was put', () => {
  const grid = drawn('grid', {}, { x: 4, y: -9, size: 0.5, rows: 4, columns: 4, color: '#0000c4' })
  assert.equal(at(grid, 6, -7)[0].color, '#0000c4')
  assert.ok(at(grid, 4, -9).length)
  assert.deepEqual([...at(grid, 6.5, -6.5), ...at(grid, 4.25, -8.75)], [])
})

test('a laser scan lies before the robot, without rays that had no echo', () => {
  const ranges = Array.from({ length: 31 }, (_, i) => (i === 3 ? null : 2))
  const scan = { angle_min: -Math.PI / 4, angle_increment: Math.PI / 60, range_min: 0.1, range_max: 10, ranges }
  const header = { frame_id: 'base_link' }
  const shapes = drawn('laserscan', { header, ...scan }, { by: 'one colour', color: '#00c8c8' })
  assert.equal(shapes.length, 30)
  assert.equal(at(shapes, 10, 7)[0].color, '#00c8c8')
  assert.deepEqual(at(shapes, 10, 6), [])
})

const PAIR = [
  { x: -0.4, y: 0 },
  { x: 0.4, y: 0 },
]
const CORNERS = [
  { x: -0.5, y: -0.5 },
  { x: 0.5, y: -0.5 },
  { x: 0, y: 0.6 },
]
const MARKERS: [name: string, kind: string, points?: { x: number; y: number }[]][] = [
  ['arrow', 'Polygon'],
  ['cube', 'Polygon'],
  ['sphere', 'Polygon'],
  ['cylinder', 'Polygon'],
  ['strip', 'LineString', PAIR],
  ['list', 'LineString', PAIR],
  ['cubes', 'Polygon', PAIR],
  ['spheres', 'Polygon', PAIR],
  ['points', 'Point', PAIR],
  ['text', 'Point'],
  ['mesh', 'Polygon'],
  ['triangle', 'Polygon', CORNERS],
]

test('each kind of marker is drawn at its place in its colour', () => {
  for (const [type, [name, kind, points]] of MARKERS.entries()) {
    const size = points === PAIR ? 0.2 : 0.6
    const own = { header: MAP, type, pose: pose(2, -19), scale: { x: size, y: size }, color: ORANGE }
    const shapes = drawn('marker', { ...own, points, text: 'weed 7' })
    const beside = points === PAIR ? 0.4 : 0.01
    const found = at(shapes, 2 + beside, -19)
    assert.deepEqual([found[0]?.kind, found[0]?.color], [kind, 'rgb(255 128 0)'], name)
    if (name === 'text') assert.equal(found[0].label, 'weed 7')
    assert.deepEqual(at(shapes, 4, -19), [], name)
  }
})

test('odometry has an ellipse of its covariance: 2.45 sigmas', () => {
  const covariance = Array.from({ length: 36 }, (_, i) => (i === 0 ? 0.25 : i === 7 ? 0.04 : 0))
  const shapes = drawn('odometry', { header: MAP, pose: { pose: pose(18, -7), covariance } }, { color: '#8b2fc9' })
  assert.equal(at(shapes, 18, -7)[0].color, '#8b2fc9')
  assert.ok(at(shapes, 18 + 1.15, -7).length)
  assert.deepEqual([...at(shapes, 18 + 1.4, -7), ...at(shapes, 18, -7 + 0.7)], [])
})

test('a path and a route are lines, and the place on the route is an arrow', () => {
  const poses = [20, 21, 22].map((x) => ({ pose: pose(x, -7) }))
  const line = at(drawn('path', { header: MAP, poses }, { color: '#123456' }), 21, -7)
  assert.deepEqual([line[0].kind, line[0].color], ['LineString', '#123456'])
  const route = { header: MAP, route_points: poses, position_m: 0.5 }
  const shapes = drawn('route', route, { color: '#224466', icon: '#ff0000' })
  assert.deepEqual(
    at(shapes, 20.8, -7).map(({ color }) => color),
    ['#224466', '#ff0000'],
  )
  assert.deepEqual(
    at(shapes, 21.8, -7).map(({ color }) => color),
    ['#224466'],
  )
})

test('a point cloud has the colours of its points', () => {
  const view = new DataView(new ArrayBuffer(48))
  for (let i = 0; i < 3; i++) {
    ;[i, -11, i].forEach((value, field) => view.setFloat32(16 * i + 4 * field, value, true))
    view.setUint32(16 * i + 12, 0xff0000 >> (8 * i), true)
  }
  const fields = ['x', 'y', 'z', 'rgb'].map((name, i) => ({ name, offset: 4 * i, datatype: 7 }))
  const data = [...new Uint8Array(view.buffer)]
  const cloud = { header: MAP, fields, point_step: 16, width: 3, height: 1, data }
  const shapes = drawn('pointcloud2', cloud, { by: 'rgb' })
  for (const [i, color] of ['#ff0000', '#00ff00', '#0000ff'].entries())
    assert.deepEqual(
      at(shapes, i, -11).map((point) => point.color),
      [color],
    )
})

test('a pose looks along its heading, and a frame has a red axis ahead and a green one to the left', () => {
  const arrow = drawn(
    'pose',
    { header: MAP, pose: pose(4, -11, Math.PI / 2) },
    { style: 'arrows', size: 8, color: '#ff8800' },
  )
  assert.equal(at(arrow, 4, -10.3)[0].color, '#ff8800')
  assert.deepEqual(at(arrow, 4, -11.5), [])
  const transform = { translation: { x: 22, y: -11 }, rotation: ofYaw(0) }
  const axes = drawn('tf_frame', { header: MAP, child_frame_id: 'tool', transform })
  assert.equal(at(axes, 22.7, -11)[0].color, '#d22f26')
  assert.equal(at(axes, 22, -10.3)[0].color, '#17923f')
})

test('features come as they are or as the text of a topic, and other text draws nothing', () => {
  const at = projection.toLonLat(3, 4)
  const post = { type: 'Feature', properties: {}, geometry: { type: 'Point', coordinates: at } }
  const [own] = drawn('geojson', post, { color: '#d07000' })
  assert.equal(own.color, '#d07000')
  assert.deepEqual(drawn('geojson', { data: JSON.stringify(post) }, { color: '#d07000' }), [own])
  for (const data of ['hoeing', 'null', '{"type": "Point"}']) assert.deepEqual(drawn('geojson', { data }), [])
})
