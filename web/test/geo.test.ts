import assert from 'node:assert/strict'
import { test } from 'node:test'
import { areaM2, compassDeg, compassText, lengthM, placeOutline, Projection } from '../src/geo.ts'

const datum = { lat_deg: 21.1613331649, lon_deg: 72.7870533933 }

test('a point goes to longitude and latitude and comes back within a nanometre', () => {
  const projection = new Projection(datum)
  const [lon, lat] = projection.toLonLat(123.456, -78.9)
  const [x, y] = projection.toMap(lon, lat)
  assert.ok(Math.hypot(x - 123.456, y + 78.9) < 1e-6)
})

test('a second of arc on the ellipsoid has the length that the tables give', () => {
  // 21.1613° N: 1″ of latitude = 30.7553 m, 1″ of longitude = 28.8495 m (PROJ, WGS-84)
  const [x, y] = new Projection(datum).toMap(datum.lon_deg + 1 / 3600, datum.lat_deg + 1 / 3600)
  assert.ok(Math.abs(y - 30.7553) < 0.0005, String(y))
  assert.ok(Math.abs(x - 28.8495) < 0.0005, String(x))
})

test('the area of a square does not depend on its direction or on a repeated last point', () => {
  assert.equal(
    areaM2([
      [0, 0],
      [2, 0],
      [2, 2],
      [0, 2],
    ]),
    4,
  )
  assert.equal(
    areaM2([
      [0, 2],
      [2, 2],
      [2, 0],
      [0, 0],
      [0, 2],
    ]),
    4,
  )
})

test('a length is the sum of its legs', () =>
  assert.equal(
    lengthM([
      [0, 0],
      [3, 4],
      [3, 5],
    ]),
    6,
  ))

test('east is compass 90, north is 0, west is 270', () => {
  assert.deepEqual(
    [0, Math.PI / 2, Math.PI].map((yaw) => Math.round(compassDeg(yaw))),
    [90, 0, 270],
  )
})

test('an outline turned left by 90 degrees has its nose in the north', () => {
  const [[x, y]] = placeOutline([[1, 0]], 5, 6, Math.PI / 2)
  assert.ok(Math.hypot(x - 5, y - 7) < 1e-12)
})

test('a heading a hair west of north is shown as 0, never as 360', () => {
  assert.equal(compassText(Math.PI / 2 + 0.001), '0°')
  assert.equal(compassText(Math.PI / 2 - 0.02), '1°')
  assert.equal(compassText(Math.PI), '270°')
})
