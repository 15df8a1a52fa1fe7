/** A field being drawn: shapes in map metres, with undo. Nothing here touches the saved field. */

import type { Feature, FeatureCollection, Geometry, Position } from 'geojson'
import type { Projection } from '../geo.ts'
import type { Field, Vec2 } from '../wire.ts'

export const KINDS = ['boundary', 'obstacle', 'row', 'crop', 'ab_line', 'waypoint'] as const
export type Kind = (typeof KINDS)[number]
export type ShapeType = 'polygon' | 'line' | 'point'
export interface Shape {
  id: string
  kind: Kind
  points: Vec2[]
}

const HISTORY = 100
const MAX_REPEATED = 500
const MIN_SPACING_M = 0.05
/** Decimals of a degree: 0.1 mm. */
const DEGREE_DECIMALS = 9

export const SHAPE_OF: Record<Kind, ShapeType> = {
  boundary: 'polygon',
  obstacle: 'polygon',
  row: 'line',
  crop: 'line',
  ab_line: 'line',
  waypoint: 'point',
}
const FEWEST: Record<ShapeType, number> = { polygon: 3, line: 2, point: 1 }

export class PlanDocument {
  shapes: Shape[] = []
  private past: Shape[][] = []
  private future: Shape[][] = []

  /** Begin with these shapes; there is nothing to undo. */
  start(shapes: Shape[]): void {
    this.shapes = shapes
    this.past = []
    this.future = []
  }

  /** Replace the shapes as one step that can be undone. */
  change(shapes: Shape[]): void {
    if (JSON.stringify(shapes) === JSON.stringify(this.shapes)) return
    this.past.push(this.shapes)
    if (this.past.length > HISTORY) this.past.shift()
    this.future = []
    this.shapes = shapes
  }

  /** Move one vertex; false for an unknown one. */
  moveVertex(id: string, index: number, to: Vec2): boolean {
    const shape = this.shapes.find((s) => s.id === id)
    if (!shape?.points[index] || !to.every(Number.isFinite)) return false
    this.change(
      this.shapes.map((s) => (s.id === id ? { ...s, points: s.points.map((p, i) => (i === index ? to : p)) } : s)),
    )
    return true
  }

  remove(id: string): void {
    this.change(this.shapes.filter((s) => s.id !== id))
  }

  /** Move a waypoint one place earlier (-1) or later (+1) in the order they are driven. */
  reorder(id: string, by: -1 | 1): void {
    const waypoints = this.shapes.filter((s) => s.kind === 'waypoint')
    const from = waypoints.findIndex((s) => s.id === id)
    const other = waypoints[from + by]
    if (from < 0 || !other) return
    this.change(this.shapes.map((s) => (s.id === id ? other : s.id === other.id ? waypoints[from] : s)))
  }

  /** More rows like this one, each `spacingM` further to the left of its direction; negative ones to the right. */
  repeat(id: string, count: number, spacingM: number): void {
    const row = this.shapes.find((s) => s.id === id)
    if (
      !row ||
      !(count >= 1 && count <= MAX_REPEATED) ||
      !Number.isFinite(spacingM) ||
      Math.abs(spacingM) < MIN_SPACING_M
    )
      return
    const [[x0, y0], [x1, y1]] = [row.points[0], row.points[row.points.length - 1]]
    const length = Math.hypot(x1 - x0, y1 - y0)
    if (!length) return
    const left: Vec2 = [(-(y1 - y0) / length) * spacingM, ((x1 - x0) / length) * spacingM]
    const copies = Array.from(
      { length: Math.floor(count) },
      (_, i): Shape => ({
        id: `${id}-${i + 1}`,
        kind: row.kind,
        points: row.points.map(([x, y]): Vec2 => [x + (i + 1) * left[0], y + (i + 1) * left[1]]),
      }),
    )
    this.change([...this.shapes, ...copies])
  }

  undo(): void {
    const before = this.past.pop()
    if (!before) return
    this.future.push(this.shapes)
    this.shapes = before
  }

  redo(): void {
    const after = this.future.pop()
    if (!after) return
    this.past.push(this.shapes)
    this.shapes = after
  }

  get canUndo(): boolean {
    return this.past.length > 0
  }

  get canRedo(): boolean {
    return this.future.length > 0
  }
}

/** The field the robot works on now: its boundary and rows, or its goals where it has no rows. */
export function shapesOf(field: Field): Shape[] {
  const boundary: Shape[] = field.boundary_map_m?.length
    ? [{ id: 'boundary', kind: 'boundary', points: field.boundary_map_m }]
    : []
  const rows = field.rows.map((row): Shape => ({ id: `row-${row.index}`, kind: 'row', points: row.points_map_m }))
  const goals = rows.length
    ? []
    : field.waypoints_map_m.map((p, i): Shape => ({ id: `goal-${i}`, kind: 'waypoint', points: [p] }))
  return [...boundary, ...rows, ...goals]
}

function rounded([lon, lat]: Vec2): Position {
  return [Number(lon.toFixed(DEGREE_DECIMALS)), Number(lat.toFixed(DEGREE_DECIMALS))]
}

export function toGeometry(shape: Shape, projection: Projection): Geometry {
  const coordinates = shape.points.map(([x, y]) => rounded(projection.toLonLat(x, y)))
  switch (SHAPE_OF[shape.kind]) {
    case 'polygon':
      return { type: 'Polygon', coordinates: [[...coordinates, coordinates[0]]] }
    case 'line':
      return { type: 'LineString', coordinates }
    case 'point':
      return { type: 'Point', coordinates: coordinates[0] }
  }
}

export function toGeoJson(shapes: Shape[], projection: Projection): FeatureCollection {
  return {
    type: 'FeatureCollection',
    features: shapes.map((shape) => ({
      type: 'Feature',
      properties: { kind: shape.kind },
      geometry: toGeometry(shape, projection),
    })),
  }
}

/** Shapes of a field file. Inner rings of a boundary become obstacles; a shape of no known kind gets the usual one. */
export function fromGeoJson(collection: FeatureCollection, projection: Projection): Shape[] {
  let n = 0
  const shapes: Shape[] = []
  const add = (kind: Kind, coordinates: Position[]): void => {
    const points = coordinates.map(([lon, lat]) => projection.toMap(lon, lat))
    if (points.length >= FEWEST[SHAPE_OF[kind]]) shapes.push({ id: `shape-${n++}`, kind, points })
  }
  for (const feature of collection.features) addFeature(feature, add)
  return shapes
}

function addFeature(feature: Feature, add: (kind: Kind, coordinates: Position[]) => void): void {
  const named = KINDS.find((kind) => kind === (feature.properties as { kind?: unknown } | null)?.kind)
  const kindFor = (type: ShapeType, usual: Kind): Kind => (named && SHAPE_OF[named] === type ? named : usual)
  const polygon = ([outer, ...inner]: Position[][]): void => {
    add(kindFor('polygon', 'boundary'), outer.slice(0, -1))
    for (const ring of inner) add('obstacle', ring.slice(0, -1))
  }
  const { geometry } = feature
  if (geometry.type === 'Polygon') polygon(geometry.coordinates)
  else if (geometry.type === 'MultiPolygon') geometry.coordinates.forEach(polygon)
  else if (geometry.type === 'LineString') add(kindFor('line', 'row'), geometry.coordinates)
  else if (geometry.type === 'MultiLineString')
    for (const line of geometry.coordinates) add(kindFor('line', 'row'), line)
  else if (geometry.type === 'Point') add('waypoint', [geometry.coordinates])
  else if (geometry.type === 'MultiPoint') for (const p of geometry.coordinates) add('waypoint', [p])
}
