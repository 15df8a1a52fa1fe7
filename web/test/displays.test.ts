import assert from 'node:assert/strict'
import { test } from 'node:test'
import { fieldOf, ramp } from '../src/displays/clouds.ts'
import { placedBox, sizeOf } from '../src/displays/instruments.ts'
import { foldMarkers } from '../src/displays/markers.ts'
import { anglesOf, frameOf, ofYaw, within } from '../src/displays/messages.ts'
import { filled, number } from '../src/displays/options.ts'
import { cellColour, foldGrid } from '../src/displays/pictures.ts'
import { along, extended, laps } from '../src/displays/tracks.ts'
import { DISPLAY_TYPES } from '../src/displays/types.ts'
import { Projection } from '../src/geo.ts'

const setting = {
  options: {},
  robot: [10, 5, Math.PI / 2] as [number, number, number],
  projection: new Projection({ lat_deg: 50, lon_deg: 8 }),
}

test('every plugin of mapviz has its row, once', () => {
  const mapviz = [
    'attitude_indicator',
    'coordinate_picker',
    'disparity',
    'draw_polygon',
    'float',
    'gps',
    'grid',
    'image',
    'laserscan',
    'marker',
    'measuring',
    'move_base',
    'navsat',
    'occupancy_grid',
    'odometry',
    'path',
    'plan_route',
    'point_click_publisher',
    'pointcloud2',
    'pose',
    'robot_image',
    'route',
    'string',
    'textured_marker',
    'tf_frame',
    'tile_map',
    'multires_image',
  ]
  assert.deepEqual(
    DISPLAY_TYPES.map(({ id }) => id).filter((id) => id !== 'geojson'),
    mapviz,
  )
})

test('a pose in the frame of the robot is turned and moved with it', () => {
  const body = frameOf({ frame_id: 'base_link' }, setting.robot)
  const [x, y, yaw] = within(body, { position: { x: 2, y: 1 }, orientation: ofYaw(0.1) })
  assert.ok(Math.hypot(x - 9, y - 7) < 1e-9)
  assert.ok(Math.abs(yaw - Math.PI / 2 - 0.1) < 1e-9)
  assert.deepEqual(frameOf({ frame_id: 'map' }, setting.robot), [0, 0, 0])
})

test('roll and pitch come back from a quaternion', () => {
  const { roll, pitch } = anglesOf({
    w: Math.cos(0.1) * Math.cos(0.2),
    x: Math.sin(0.1) * Math.cos(0.2),
    y: Math.cos(0.1) * Math.sin(0.2),
    z: -Math.sin(0.1) * Math.sin(0.2),
  })
  assert.ok(Math.abs(roll - 0.2) < 1e-9)
  assert.ok(Math.abs(pitch - 0.4) < 1e-9)
})

test('a track keeps no place nearer than its tolerance and no more than its buffer', () => {
  const options = { tolerance_m: 1, buffer: 3 }
  let track: ReturnType<typeof extended> = []
  for (let i = 0; i <= 20; i++) track = extended(track, { p: [i / 2, 0], yaw: null, cov: null, t: null }, options)
  assert.deepEqual(
    track.map((place) => place.p[0]),
    [8, 9, 10],
  )
})

test('a track that comes back to its start begins another lap', () => {
  const round = (n: number): [number, number] => [5 * Math.cos((n * Math.PI) / 10), 5 * Math.sin((n * Math.PI) / 10)]
  const track = Array.from({ length: 45 }, (_, n) => ({ p: round(n), yaw: null, cov: null, t: null }))
  assert.equal(laps(track).length, 3)
})

test('a place along a route lies on the leg that its distance says', () => {
  assert.deepEqual(
    along(
      [
        [0, 0],
        [3, 0],
        [3, 4],
      ],
      5,
    ),
    [3, 2, Math.PI / 2],
  )
  assert.equal(along([[0, 0]], 1), null)
})

test('a cloud that is cut off gives the points that are whole', () => {
  const bytes = new Uint8Array(new Float32Array([1, 2, 3, 4, 5]).buffer)
  const fields = [
    { name: 'x', offset: 0, datatype: 7 },
    { name: 'y', offset: 4, datatype: 7 },
  ]
  const cloud = { fields, point_step: 8, width: 9, height: 1, data: [...bytes] }
  assert.deepEqual(fieldOf(cloud, 'x'), [1, 3, 5])
  assert.deepEqual(fieldOf(cloud, 'y'), [2, 4])
  assert.equal(fieldOf(cloud, 'z'), null)
})

test('colours run from red to violet and stop there', () => {
  assert.equal(ramp(-1, true, '#000000'), ramp(0, true, '#000000'))
  assert.notEqual(ramp(0, true, '#000000'), ramp(1, true, '#000000'))
})

test('markers are changed, deleted one by one and all at once', () => {
  const cube = { type: 1, ns: 'a', id: 1 }
  let known = foldMarkers(undefined, { markers: [cube, { ...cube, id: 2 }, { ...cube, ns: 'b' }] }, setting)
  assert.equal(known.size, 3)
  known = foldMarkers(known, { ...cube, action: 2 }, setting)
  assert.deepEqual([...known.keys()], ['a/2', 'b/1'])
  assert.equal(foldMarkers(known, { ...cube, action: 3 }, setting).size, 0)
})

test('an update of an occupancy grid changes its own cells only', () => {
  const whole = foldGrid(undefined, { info: { resolution: 1, width: 3, height: 2 }, data: [0, 0, 0, 0, 0, 0] }, setting)
  const changed = foldGrid(whole, { x: 1, y: 1, width: 2, height: 1, data: [100, -1] }, setting)
  assert.deepEqual([...(changed?.cells ?? [])], [0, 0, 0, 0, 100, 255])
  assert.equal(cellColour(0, 'costmap')[3], 0)
})

test('a box keeps to its corner in pixels and in shares of the map', () => {
  const map = { width: 800, height: 600 }
  assert.deepEqual(placedBox({ anchor: 'bottom right', offset_x: 10, offset_y: 20 }, map, 100, 50), {
    x: 690,
    y: 530,
    w: 100,
    h: 50,
  })
  assert.deepEqual(sizeOf({ units: '%', w: 50, keep_ratio: true }, map, { width: 200, height: 100 }), [400, 200])
})

test('a saved option of the wrong type gives way to the usual value', () => {
  assert.deepEqual(filled([number('size', 'Size', 3, 1, 9, 1)], { size: 'big', gone: 1 }), { size: 3 })
})
