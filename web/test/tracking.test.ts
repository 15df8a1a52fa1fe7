import assert from 'node:assert/strict'
import { test } from 'node:test'
import { Projection, RAD } from '../src/geo.ts'
import { FOLLOWING, Tracking } from '../src/map/tracking.ts'
import type { Vec2 } from '../src/wire.ts'

const [WIDTH, HEIGHT] = [800, 600]
const PX_PER_M = 20

/** A map of flat ground that counts its moves, with the robot on it. */
function setUp() {
  const projection = new Projection({ lat_deg: 50, lon_deg: 8 })
  const now = {
    centre: [0, 0] as Vec2,
    bearing: 0,
    isMoving: false,
    pose: [0, 0, 0] as [number, number, number],
    moves: 0,
    glides: 0,
    remembered: 0,
  }
  const map = {
    isMoving: () => now.isMoving,
    getBearing: () => now.bearing,
    project([lon, lat]: Vec2) {
      const [x, y] = projection.toMap(lon, lat)
      return { x: WIDTH / 2 + PX_PER_M * (x - now.centre[0]), y: HEIGHT / 2 - PX_PER_M * (y - now.centre[1]) }
    },
    jumpTo(to: { center?: Vec2; bearing?: number }, why?: unknown) {
      if (to.center) {
        now.centre = projection.toMap(...to.center)
        assert.equal(why, FOLLOWING)
        now.moves++
      }
      now.bearing = to.bearing ?? now.bearing
    },
    easeTo(to: { center?: Vec2; bearing?: number }) {
      map.jumpTo(to, FOLLOWING)
      now.glides++
    },
  }
  const state = {
    get pose() {
      return now.pose
    },
  }
  const view = {
    app: { projection, store: { state } },
    map,
    node: { isConnected: true, clientWidth: WIDTH, clientHeight: HEIGHT },
    isFilled: true,
    fitted: null as unknown,
    refit: () => false,
    remember: () => void now.remembered++,
  }
  const tracking = new Tracking(view as never)
  const drive = (...pose: [number, number, number]): void => {
    now.pose = pose
    tracking.follow()
  }
  return { now, view, tracking, drive }
}

function isNear(found: readonly number[], wanted: readonly number[]): void {
  found.forEach((value, i) => assert.ok(Math.abs(value - wanted[i]) < 1e-6, `${found} is not ${wanted}`))
}

test('a robot in the middle stays there with north up, and one whose heading is up turns the map', () => {
  const { now, tracking, drive } = setUp()
  tracking.choose('position')
  drive(6, 0, 0)
  isNear(now.centre, [6, 0])
  drive(20, 1.5, Math.PI)
  isNear([...now.centre, now.bearing], [20, 1.5, 0])
  tracking.choose('heading')
  isNear([now.bearing], [90 - 180])
  drive(6, 0, 0)
  isNear([...now.centre, now.bearing], [6, 0, 90])
  tracking.turn()
  isNear([...now.centre, now.bearing], [6, 0, 180])
  assert.deepEqual(tracking.told(), { target: 'heading', turn: 90 })
})

test('a map that was moved by hand stays there, and goes back to what it followed', () => {
  const { now, tracking, drive } = setUp()
  const told: string[] = []
  tracking.onTarget = () => void told.push(tracking.target)
  tracking.choose('heading')
  tracking.set('map') // as when somebody drags it
  drive(20, 0, 0)
  isNear(now.centre, [0, 0])
  tracking.toggle()
  isNear([...now.centre, now.bearing], [20, 0, 90])
  tracking.toggle()
  assert.deepEqual(told, ['heading', 'map', 'heading', 'map'])
})

test('the map goes after a robot that moved while the map did, and where it did not fill its place', () => {
  const { now, view, tracking, drive } = setUp()
  tracking.choose('position')
  now.isMoving = true
  drive(5, 0, 0)
  isNear(now.centre, [0, 0])
  now.isMoving = false
  view.isFilled = false
  tracking.follow()
  isNear(now.centre, [0, 0])
  view.isFilled = true
  tracking.follow()
  isNear(now.centre, [5, 0])
  const { moves } = now
  tracking.follow()
  assert.equal(now.moves, moves, 'nothing is drawn anew for a robot that stands')
})

test('a robot that is kept in view moves the map only where it leaves the middle part', () => {
  const { now, tracking, drive } = setUp()
  assert.equal(tracking.target, 'near')
  drive((0.35 * WIDTH) / PX_PER_M, 0, 0)
  assert.equal(now.moves, 0)
  drive((0.37 * WIDTH) / PX_PER_M, 0, 0)
  assert.deepEqual([now.moves, now.glides], [1, 1])
})

test('what the map stays on is kept with the view, and the turn of a map that does not turn is its own', () => {
  const { now, tracking } = setUp()
  now.pose = [3, 2, 45 * RAD]
  tracking.take('heading', 270)
  isNear([...now.centre, now.bearing], [3, 2, 315])
  assert.deepEqual(tracking.told(), { target: 'heading', turn: 270 })
  tracking.take('map', 180)
  assert.deepEqual([tracking.told(), now.bearing], [{ target: 'map', turn: 180 }, 180])
  assert.equal(now.remembered, 2)
})
