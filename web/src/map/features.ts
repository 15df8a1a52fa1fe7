/** What the robot and the server say, as GeoJSON for the map's sources. */

import type { Feature, Position } from 'geojson'
import type { Projection } from '../geo.ts'
import { collection, EMPTY } from '../geojson.ts'
import type { Features } from '../geojson.ts'
import type { Path } from '../store.ts'
import type { Field, Vec2, Weed } from '../wire.ts'

const ROW_LABEL_M = 1

function line(coordinates: Position[], properties: Record<string, unknown> = {}): Feature {
  return { type: 'Feature', properties, geometry: { type: 'LineString', coordinates } }
}

function point(coordinates: Position, properties: Record<string, unknown> = {}): Feature {
  return { type: 'Feature', properties, geometry: { type: 'Point', coordinates } }
}

export function project(projection: Projection, points: Vec2[]): Position[] {
  return points.map(([x, y]) => projection.toLonLat(x, y))
}

export function fieldFeatures(
  field: Field,
  projection: Projection,
): { boundary: Features; obstacles: Features; rows: Features } {
  const area = (ring: Vec2[]): Feature => ({
    type: 'Feature',
    properties: {},
    geometry: { type: 'Polygon', coordinates: [project(projection, [...ring, ring[0]])] },
  })
  const boundary = field.boundary_map_m?.length ? [area(field.boundary_map_m)] : []
  const rows = field.rows.flatMap((row) => [
    line(project(projection, row.points_map_m), { index: row.index }),
    point(projection.toLonLat(...before(row.points_map_m[0], row.points_map_m[1])), { label: String(row.index + 1) }),
  ])
  const worked = new Set(field.rows.map((row) => JSON.stringify(row.points_map_m)))
  const crop = field.crop_map_m.filter((row) => !worked.has(JSON.stringify(row)))
  return {
    boundary: collection(boundary),
    obstacles: collection((field.obstacles_map_m ?? []).map(area)),
    rows: collection([...rows, ...crop.map((row) => line(project(projection, row)))]),
  }
}

/** A little before the start of a row, where its number does not cover anything. */
function before(start: Vec2, end: Vec2): Vec2 {
  const length = Math.hypot(end[0] - start[0], end[1] - start[1]) || 1
  return [
    start[0] - (ROW_LABEL_M * (end[0] - start[0])) / length,
    start[1] - (ROW_LABEL_M * (end[1] - start[1])) / length,
  ]
}

export function waypointFeatures(field: Field, projection: Projection, reached: number): Features {
  return collection(
    field.waypoints_map_m.map(([x, y], i) =>
      point(projection.toLonLat(x, y), { index: i, label: String(i + 1), done: i < reached }),
    ),
  )
}

export function pathFeatures(path: Path | null, projection: Projection): Features {
  return path && path.points_map_m.length > 1 ? collection([line(project(projection, path.points_map_m))]) : EMPTY
}

export function trajectoryFeatures(pieces: Vec2[][], projection: Projection): Features {
  return collection(pieces.filter((piece) => piece.length > 1).map((piece) => line(project(projection, piece))))
}

export function weedFeature(weed: Weed, projection: Projection): Feature {
  const { id, plant, confidence, last_seen_s, treated_s } = weed
  const properties = { id, plant, confidence, last_seen_s, treated: treated_s !== null }
  const feature = point(projection.toLonLat(weed.x_map_m, weed.y_map_m), properties)
  feature.id = id
  return feature
}

/** Metric grid lines around a centre, every `stepM`, as far as `reachM`. */
export function gridFeatures(projection: Projection, centre: Vec2, stepM: number, reachM: number): Features {
  const snap = (value: number): number => Math.round(value / stepM) * stepM
  const [cx, cy] = [snap(centre[0]), snap(centre[1])]
  const features: Feature[] = []
  for (let d = -reachM; d <= reachM; d += stepM) {
    features.push(
      line(
        project(projection, [
          [cx + d, cy - reachM],
          [cx + d, cy + reachM],
        ]),
      ),
    )
    features.push(
      line(
        project(projection, [
          [cx - reachM, cy + d],
          [cx + reachM, cy + d],
        ]),
      ),
    )
  }
  return collection(features)
}

/** Weeds counted in square cells; `count` and `per_m2` on each cell. */
export function densityFeatures(weeds: Iterable<Weed>, cellM: number, projection: Projection): Features {
  const counts = new Map<string, { i: number; j: number; n: number }>()
  for (const { plant, x_map_m: x, y_map_m: y } of weeds) {
    if (plant !== 0) continue
    const i = Math.floor(x / cellM)
    const j = Math.floor(y / cellM)
    const cell = counts.get(`${i},${j}`)
    if (cell) cell.n++
    else counts.set(`${i},${j}`, { i, j, n: 1 })
  }
  return collection(
    [...counts.values()].map(({ i, j, n }) => {
      const [x, y] = [i * cellM, j * cellM]
      const ring: Vec2[] = [
        [x, y],
        [x + cellM, y],
        [x + cellM, y + cellM],
        [x, y + cellM],
        [x, y],
      ]
      return {
        type: 'Feature',
        properties: { count: n, per_m2: n / (cellM * cellM) },
        geometry: { type: 'Polygon', coordinates: [project(projection, ring)] },
      }
    }),
  )
}

/** The box [west, south, east, north] around points, or null for none. */
export function boundsOf(points: Vec2[], projection: Projection): [number, number, number, number] | null {
  if (!points.length) return null
  const xs = points.map((p) => p[0])
  const ys = points.map((p) => p[1])
  const [west, south] = projection.toLonLat(Math.min(...xs), Math.min(...ys))
  const [east, north] = projection.toLonLat(Math.max(...xs), Math.max(...ys))
  return [west, south, east, north]
}
