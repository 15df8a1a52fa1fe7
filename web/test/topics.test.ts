import assert from 'node:assert/strict'
import { test } from 'node:test'
import { foldScan } from '../src/displays/clouds.ts'
import { frameOf, placer } from '../src/displays/messages.ts'
import { filled } from '../src/displays/options.ts'
import { SCAN_OPTIONS } from '../src/displays/clouds.ts'
import { readTopicId, titleOf, topicId } from '../src/displays/topics.ts'
import { Projection } from '../src/geo.ts'

const ROBOT: [number, number, number] = [10, 5, Math.PI / 2]
/** A camera that looks ahead: its z axis is the robot's x axis, its x axis points right. */
const OPTICAL = [0, 0, 1, 0.5, -1, 0, 0, 0, 0, -1, 0, 1, 0, 0, 0, 1]

function close([x, y]: readonly number[], [a, b]: readonly number[]): void {
  assert.ok(Math.hypot(x - a, y - b) < 1e-9, `${x}, ${y} is not ${a}, ${b}`)
}

test('the id of a topic names its network, and nothing else is one', () => {
  for (const [source, name] of [
    ['ros1', '/scan'],
    ['ros2', '/agribot/weeds'],
    ['dds', '/scan'],
    ['recording', 'frame:base_link'],
    ['bag:a:b.bag', '/tf'],
  ])
    assert.deepEqual(readTopicId(topicId(source, name)), { source, name })
  for (const id of ['gnss', 'layer-scan', 'signal:v_mps', 'ros1:scan']) assert.equal(readTopicId(id), null)
  assert.equal(titleOf('frame:laser'), 'Frame laser')
})

test('a frame that the robot found lies where it says, in the map or on the robot', () => {
  const moved = [1, 0, 0, 3, 0, 1, 0, 4, 0, 0, 1, 0, 0, 0, 0, 1]
  close(frameOf({ frame_id: 'odom', in_map: moved }, ROBOT), [3, 4])
  const [x, y, yaw] = frameOf({ frame_id: 'laser', in_body: moved }, ROBOT)
  close([x, y], [6, 8])
  assert.equal(yaw, ROBOT[2])
})

test('points of a camera that looks ahead lie before the robot', () => {
  const place = placer({ frame_id: 'camera', in_body: OPTICAL }, ROBOT)
  close(place({ x: 0, y: 0, z: 2 }), [10, 7.5])
  close(place({ x: 1, y: 0, z: 2 }), [11, 7.5])
})

test('a scan in a frame of the tree is drawn in the map', () => {
  const moved = [0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 0, 0, 0, 0, 1]
  const scan = {
    header: { frame_id: 'laser', in_map: moved },
    angle_min: 0,
    angle_increment: 0.1,
    range_min: 0,
    range_max: 10,
    ranges: [2, null],
  }
  const setting = {
    options: filled(SCAN_OPTIONS),
    robot: ROBOT,
    projection: new Projection({ lat_deg: 50, lon_deg: 8 }),
  }
  const [spots] = foldScan(undefined, scan, setting)
  assert.equal(spots.length, 1)
  close(spots[0].p, [1, 4])
})
