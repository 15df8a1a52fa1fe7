/** The map's layers from bottom to top: which sources they draw and how, and which the operator may hide. */

import type { AddLayerObject, Map as MapLibre } from 'maplibre-gl'
import { FADED } from '../displays/host.ts'
import type { LayerGroup } from '../displays/host.ts'
import { EMPTY, SOURCE_MAXZOOM } from '../geojson.ts'
import type { Palette } from '../shell/palette.ts'
import { type ByZoom, byPlant } from './plant-size.ts'
import { say } from '../say.ts'

/** What can be shown and hidden, from top to bottom. */
export function layerGroups(): LayerGroup[] {
  const group = (id: string, title: string, layers: string[], visible = true): LayerGroup => ({
    id,
    title,
    layers,
    visible,
    opacity: 1,
  })
  return [
    group('robot', say('robot'), []),
    group('waypoints', say('goals'), ['waypoints', 'waypoint-labels']),
    group('trajectory', say('drivenTrack'), ['trajectory']),
    group('path', say('plannedPath'), ['path']),
    group('weeds', say('weeds'), ['weeds']),
    group('density', say('weedDensity'), ['density'], false),
    group('rows', say('cropRows'), ['rows', 'row-labels']),
    group('obstacles', say('obstacles'), ['obstacles-fill', 'obstacles']),
    group('boundary', say('fieldBoundary'), ['boundary-fill', 'boundary']),
    group('grid', say('metricGrid'), ['grid-1', 'grid-10']),
  ]
}

export const SOURCES = [
  'grid-1',
  'grid-10',
  'boundary',
  'obstacles',
  'rows',
  'density',
  'weeds',
  'path',
  'trajectory',
  'waypoints',
] as const
export type SourceId = (typeof SOURCES)[number]

const OPACITY: Record<string, string[]> = {
  line: ['line-opacity'],
  fill: ['fill-opacity'],
  symbol: ['icon-opacity'],
  raster: ['raster-opacity'],
  circle: ['circle-opacity', 'circle-stroke-opacity'],
}

function byZoom(...stops: number[]): ByZoom {
  return ['interpolate', ['exponential', 1.6], ['zoom'], ...stops]
}

function fieldLayers(c: Palette): AddLayerObject[] {
  const hair = byZoom(14, 0.4, 22, 1.2)
  return [
    { id: 'grid-1', type: 'line', source: 'grid-1', minzoom: 19, paint: { 'line-color': c.grid, 'line-width': hair } },
    {
      id: 'grid-10',
      type: 'line',
      source: 'grid-10',
      minzoom: 14,
      paint: { 'line-color': c.grid, 'line-width': byZoom(14, 0.6, 22, 2.4) },
    },
    {
      id: 'boundary-fill',
      type: 'fill',
      source: 'boundary',
      paint: { 'fill-color': c.boundary, 'fill-opacity': 0.07 },
    },
    { id: 'boundary', type: 'line', source: 'boundary', paint: { 'line-color': c.boundary, 'line-width': 2 } },
    { id: 'obstacles-fill', type: 'fill', source: 'obstacles', paint: { 'fill-color': c.weed, 'fill-opacity': 0.35 } },
    { id: 'obstacles', type: 'line', source: 'obstacles', paint: { 'line-color': c.weed, 'line-width': 2 } },
    {
      id: 'density',
      type: 'fill',
      source: 'density',
      paint: {
        'fill-color': c.weed,
        'fill-opacity': ['interpolate', ['linear'], ['get', 'per_m2'], 0, 0.08, 4, 0.75],
      },
    },
    {
      id: 'rows',
      type: 'line',
      source: 'rows',
      layout: { 'line-cap': 'round' },
      paint: { 'line-color': c.row, 'line-width': byZoom(16, 1, 20, 4, 23, 30) },
    },
  ]
}

function liveLayers(c: Palette): AddLayerObject[] {
  return [
    {
      id: 'path',
      type: 'line',
      source: 'path',
      paint: { 'line-color': c.path, 'line-width': byZoom(16, 1, 22, 3), 'line-dasharray': [3, 2] },
    },
    {
      id: 'weeds',
      type: 'circle',
      source: 'weeds',
      paint: {
        // Weeds are discs, crops larger rings: not everybody distinguishes them by colour alone.
        'circle-radius': byPlant(byZoom(15, 1, 19, 2.4, 22, 9), [1.5, 3.8, 14]),
        'circle-color': ['match', ['get', 'plant'], 0, c.weed, c.crop],
        'circle-opacity': ['match', ['get', 'plant'], 0, ['case', ['get', 'treated'], 0.35, 0.9], 0],
        'circle-stroke-color': ['match', ['get', 'plant'], 0, c.weed, c.crop],
        'circle-stroke-width': ['match', ['get', 'plant'], 0, ['case', ['get', 'treated'], 1.5, 0], 2],
      },
    },
    {
      id: 'trajectory',
      type: 'line',
      source: 'trajectory',
      layout: { 'line-join': 'round', 'line-cap': 'round' },
      paint: { 'line-color': c.trajectory, 'line-width': byZoom(14, 1.5, 22, 5) },
    },
    {
      id: 'waypoints',
      type: 'circle',
      source: 'waypoints',
      paint: {
        'circle-radius': byZoom(15, 2, 19, 5, 22, 11),
        'circle-color': ['case', ['get', 'done'], c.goalDone, c.goal],
        'circle-stroke-color': c.halo,
        'circle-stroke-width': 1.5,
      },
    },
    label('waypoint-labels', 'waypoints', c, 20.5, 'bottom-left'),
    label('row-labels', 'rows', c, 18.5, 'center'),
  ]
}

/** Text as images drawn on demand (`text:…`, see texture.ts): a font on the map would need glyph files. */
function label(
  id: string,
  source: string,
  c: Palette,
  minzoom: number,
  anchor: 'center' | 'bottom-left',
): AddLayerObject {
  return {
    id,
    type: 'symbol',
    source,
    minzoom,
    filter: ['==', ['geometry-type'], 'Point'],
    layout: {
      'icon-image': ['concat', `text:${c.ink}:${c.halo}:`, ['get', 'label']],
      'icon-anchor': anchor,
      'icon-allow-overlap': true,
    },
  }
}

export function addLayers(map: MapLibre, colours: Palette): void {
  for (const id of SOURCES) map.addSource(id, { type: 'geojson', data: EMPTY, maxzoom: SOURCE_MAXZOOM })
  for (const layer of [...fieldLayers(colours), ...liveLayers(colours)]) map.addLayer(layer)
}

/** The same layers in other colours. */
export function recolour(map: MapLibre, colours: Palette): void {
  map.setPaintProperty('background', 'background-color', colours.ground)
  for (const layer of [...fieldLayers(colours), ...liveLayers(colours)]) {
    for (const [name, value] of Object.entries(layer.type === 'custom' ? {} : (layer.paint ?? {}))) {
      if (!name.endsWith('opacity')) map.setPaintProperty(layer.id, name as 'line-color', value as string)
    }
    if (layer.type === 'symbol') {
      const layout = layer.layout as { 'icon-image': string } | undefined
      map.setLayoutProperty(layer.id, 'icon-image', layout?.['icon-image'])
    }
  }
}

export function applyGroup(map: MapLibre, group: LayerGroup, base: ReadonlyMap<string, unknown>): void {
  for (const id of group.layers) {
    const layer = map.getLayer(id)
    if (!layer) continue
    map.setLayoutProperty(id, 'visibility', group.visible ? 'visible' : 'none')
    for (const name of OPACITY[layer.type] ?? []) {
      const own = base.get(`${id}.${name}`) ?? 1
      map.setPaintProperty(
        id,
        name as 'line-opacity',
        scaled(own, group.opacity * (group.isFaded ? FADED : 1)) as number,
      )
    }
  }
}

/** The opacity the layers start with, which the operator's slider scales. */
export function baseOpacities(map: MapLibre): Map<string, unknown> {
  return new Map(map.getStyle().layers.flatMap(({ id }) => opacitiesOf(map, id)))
}

export function opacitiesOf(map: MapLibre, id: string): [string, unknown][] {
  const names = OPACITY[map.getLayer(id)?.type ?? ''] ?? []
  return names.map((name) => [`${id}.${name}`, map.getPaintProperty(id, name as 'line-opacity') ?? 1])
}

/** `['*', …]` may not wrap a zoom expression, but every opacity here is a number or a data expression. */
function scaled(own: unknown, by: number): unknown {
  if (by === 1) return own
  return typeof own === 'number' ? own * by : ['*', by, own]
}
