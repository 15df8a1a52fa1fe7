/** Drawing and dragging shapes on the map with terra-draw; the document stays the truth. */

import { Marker } from 'maplibre-gl'
import type { GeoJSONSource } from 'maplibre-gl'
import {
  TerraDraw,
  TerraDrawLineStringMode,
  TerraDrawPointMode,
  TerraDrawPolygonMode,
  TerraDrawSelectMode,
} from 'terra-draw'
import type { GeoJSONStoreFeatures } from 'terra-draw'
import { TerraDrawMapLibreGLAdapter } from 'terra-draw-maplibre-gl-adapter'
import type { Feature, Geometry } from 'geojson'
import { el } from '../dom.ts'
import { EMPTY, SOURCE_MAXZOOM } from '../geojson.ts'
import type { MapView } from '../map/view.ts'
import { colour } from '../shell/theme.ts'
import type { PlanReply, Vec2 } from '../wire.ts'
import type { Kind, PlanDocument, Shape, ShapeType } from './document.ts'
import { SHAPE_OF, toGeometry } from './document.ts'

const MODE: Record<ShapeType, string> = { polygon: 'polygon', line: 'linestring', point: 'point' }
const COLOUR: Record<Kind, string> = {
  boundary: 'map-boundary',
  obstacle: 'map-weed',
  row: 'map-row',
  crop: 'map-row',
  ab_line: 'map-ellipse',
  waypoint: 'map-goal',
}
const PATH = 'plan-path'

type Hex = `#${string}`

export class Drawing {
  onChange: () => void = () => undefined
  onSelect: (id: string | null) => void = () => undefined
  private readonly draw: TerraDraw
  private readonly kinds = new Map<string, Kind>()
  private next: Kind | null = null
  private markers: Marker[] = []

  constructor(
    private readonly view: MapView,
    private readonly document: PlanDocument,
  ) {
    const paint = (feature: GeoJSONStoreFeatures): Hex => colour(COLOUR[this.kindOf(feature)]) as Hex
    const drag = { feature: { draggable: true, coordinates: { draggable: true, midpoints: true, deletable: true } } }
    this.draw = new TerraDraw({
      adapter: new TerraDrawMapLibreGLAdapter({ map: view.map, coordinatePrecision: 9 }),
      modes: [
        new TerraDrawPolygonMode({
          styles: { fillColor: paint, fillOpacity: 0.15, outlineColor: paint, outlineWidth: 3 },
        }),
        new TerraDrawLineStringMode({ styles: { lineStringColor: paint, lineStringWidth: 3 } }),
        new TerraDrawPointMode({ styles: { pointColor: paint, pointWidth: 8 } }),
        new TerraDrawSelectMode({
          flags: { polygon: drag, linestring: drag, point: { feature: { draggable: true } } },
        }),
      ],
    })
    this.draw.start()
    this.draw.setMode('select')
    this.draw.on('finish', (id, context) => this.finished(String(id), context.action))
    this.draw.on('select', (id) => this.onSelect(String(id)))
    this.draw.on('deselect', () => this.onSelect(null))
    view.map.addSource(PATH, { type: 'geojson', data: EMPTY, maxzoom: SOURCE_MAXZOOM })
    view.map.addLayer({
      id: PATH,
      type: 'line',
      source: PATH,
      paint: { 'line-color': colour('map-trajectory'), 'line-width': 3, 'line-dasharray': [2, 1.5] },
    })
    this.load()
  }

  /** What is being drawn; null while shapes are selected. */
  get kind(): Kind | null {
    return this.next
  }

  private kindOf(feature: GeoJSONStoreFeatures): Kind {
    return this.kinds.get(String(feature.id)) ?? this.next ?? 'boundary'
  }

  /** Start to draw a shape of a kind, or go back to selecting with null. */
  begin(kind: Kind | null): void {
    this.next = kind
    this.draw.setMode(kind ? MODE[SHAPE_OF[kind]] : 'select')
  }

  select(id: string): void {
    this.next = null
    this.draw.setMode('select')
    this.draw.selectFeature(id)
  }

  /** Show the document's shapes; they take the ids that terra-draw gives them. */
  load(): void {
    this.draw.clear()
    this.kinds.clear()
    for (const shape of this.document.shapes) {
      const feature = {
        type: 'Feature',
        properties: { mode: MODE[SHAPE_OF[shape.kind]] },
        geometry: toGeometry(shape, this.view.app.projection),
      } as GeoJSONStoreFeatures
      const id = this.draw.getFeatureId()
      this.kinds.set(String(id), shape.kind)
      const [result] = this.draw.addFeatures([{ ...feature, id }])
      if (result?.valid) shape.id = String(id)
      else this.kinds.delete(String(id))
    }
  }

  private finished(id: string, action: string): void {
    if (action === 'draw') {
      this.kinds.set(id, this.next ?? 'boundary')
      this.begin(this.next === 'waypoint' ? 'waypoint' : null)
    }
    this.document.change(this.read())
    this.onChange()
  }

  private read(): Shape[] {
    const shapes: Shape[] = []
    for (const feature of this.draw.getSnapshot()) {
      const kind = this.kinds.get(String(feature.id))
      if (kind) shapes.push({ id: String(feature.id), kind, points: this.points(feature) })
    }
    const order = new Map(this.document.shapes.map((shape, i) => [shape.id, i]))
    return shapes.sort((a, b) => (order.get(a.id) ?? Infinity) - (order.get(b.id) ?? Infinity) || 0)
  }

  private points(feature: Feature<Geometry>): Vec2[] {
    const { geometry } = feature
    const { projection } = this.view.app
    if (geometry.type === 'Polygon')
      return geometry.coordinates[0].slice(0, -1).map(([lon, lat]) => projection.toMap(lon, lat))
    if (geometry.type === 'LineString') return geometry.coordinates.map(([lon, lat]) => projection.toMap(lon, lat))
    return geometry.type === 'Point' ? [projection.toMap(geometry.coordinates[0], geometry.coordinates[1])] : []
  }

  /** The planned path, and a pin where each reason against the plan is. */
  showPlan(plan: PlanReply | null): void {
    for (const marker of this.markers) marker.remove()
    this.markers = []
    const line: Feature = {
      type: 'Feature',
      properties: {},
      geometry: { type: 'LineString', coordinates: plan?.path ?? [] },
    }
    this.view.map
      .getSource<GeoJSONSource>(PATH)
      ?.setData({ type: 'FeatureCollection', features: plan && plan.path.length > 1 ? [line] : [] })
    plan?.reasons.forEach(({ text, at_map_m: at }, i) => {
      if (!at) return
      const pin = el('div', { class: 'reason-pin', title: text }, String(i + 1))
      this.markers.push(
        new Marker({ element: pin }).setLngLat(this.view.app.projection.toLonLat(...at)).addTo(this.view.map),
      )
    })
  }

  close(): void {
    this.showPlan(null)
    this.draw.stop()
    this.view.map.removeLayer(PATH)
    this.view.map.removeSource(PATH)
  }
}
