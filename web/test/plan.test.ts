import assert from 'node:assert/strict'
import { test } from 'node:test'
import { Projection } from '../src/geo.ts'
import type { Shape } from '../src/plan/document.ts'
import { fromGeoJson, PlanDocument, toGeoJson } from '../src/plan/document.ts'

const projection = new Projection({ lat_deg: 52, lon_deg: 5 })
const square: Shape = {
  id: 'a',
  kind: 'boundary',
  points: [
    [0, 0],
    [40, 0],
    [40, 30],
    [0, 30],
  ],
}
const goal = (id: string, x: number): Shape => ({ id, kind: 'waypoint', points: [[x, 0]] })

test('a field written to GeoJSON comes back with every vertex within a millimetre', () => {
  const shapes: Shape[] = [
    square,
    {
      id: 'b',
      kind: 'row',
      points: [
        [1, 2],
        [30, 2],
      ],
    },
    goal('c', 7),
  ]
  const back = fromGeoJson(toGeoJson(shapes, projection), projection)
  assert.deepEqual(
    back.map((s) => s.kind),
    ['boundary', 'row', 'waypoint'],
  )
  shapes.forEach((shape, i) =>
    shape.points.forEach(([x, y], j) => {
      const [bx, by] = back[i].points[j]
      assert.ok(Math.hypot(bx - x, by - y) < 1e-3)
    }),
  )
})

test('a hole in an imported boundary becomes an obstacle', () => {
  const ring = (size: number) =>
    [
      [0, 0],
      [size, 0],
      [size, size],
      [0, 0],
    ].map(([x, y]) => projection.toLonLat(x, y))
  const file = {
    type: 'FeatureCollection' as const,
    features: [
      {
        type: 'Feature' as const,
        properties: null,
        geometry: { type: 'Polygon' as const, coordinates: [ring(50), ring(5)] },
      },
    ],
  }
  assert.deepEqual(
    fromGeoJson(file, projection).map((s) => s.kind),
    ['boundary', 'obstacle'],
  )
})

test('undo and redo walk through the changes, and a new change ends what could be redone', () => {
  const document = new PlanDocument()
  document.change([square])
  document.moveVertex('a', 2, [41, 31])
  document.undo()
  assert.deepEqual(document.shapes[0].points[2], [40, 30])
  document.redo()
  assert.deepEqual(document.shapes[0].points[2], [41, 31])
  document.undo()
  document.remove('a')
  assert.equal(document.canRedo, false)
  assert.equal(document.shapes.length, 0)
})

test('a vertex that is no number is refused', () => {
  const document = new PlanDocument()
  document.change([square])
  assert.equal(document.moveVertex('a', 0, [Number.NaN, 0]), false)
  assert.equal(document.moveVertex('a', 9, [0, 0]), false)
})

test('goals change places without moving the other shapes', () => {
  const document = new PlanDocument()
  document.change([goal('1', 1), square, goal('2', 2), goal('3', 3)])
  document.reorder('3', -1)
  assert.deepEqual(
    document.shapes.map((s) => s.id),
    ['1', 'a', '3', '2'],
  )
  document.reorder('1', -1)
  assert.deepEqual(
    document.shapes.map((s) => s.id),
    ['1', 'a', '3', '2'],
  )
})

test('rows are repeated at their spacing, to the left of their direction', () => {
  const document = new PlanDocument()
  document.start([
    {
      id: 'r',
      kind: 'row',
      points: [
        [0, 0],
        [0, 5],
        [0, 10],
      ],
    },
  ])
  document.repeat('r', 2, 0.75)
  assert.deepEqual(
    document.shapes.map((s) => s.points[0]),
    [
      [0, 0],
      [-0.75, 0],
      [-1.5, 0],
    ],
  )
  assert.deepEqual(document.shapes[2].points[2], [-1.5, 10])
  document.repeat('r', 1, -0.5)
  assert.deepEqual(document.shapes[3].points[0], [0.5, 0])
  for (const [count, spacing] of [
    [0, 1],
    [501, 1],
    [2, 0],
    [2, NaN],
    [NaN, 1],
  ])
    document.repeat('r', count, spacing)
  assert.equal(document.shapes.length, 4)
  document.undo()
  assert.equal(document.shapes.length, 3)
})
