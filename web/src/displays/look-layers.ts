/** The map layers that draw the shapes of any display, each by the look that its features carry. */

import type {
  CircleLayerSpecification,
  FillLayerSpecification,
  LineLayerSpecification,
  SymbolLayerSpecification,
  ExpressionSpecification,
} from 'maplibre-gl'
import { palette } from '../shell/palette.ts'

const CIRCUMFERENCE_M = 40_075_016.686
const TILE_PX = 512
const DEEPEST = 24

/** Pixels (`name`) plus metres (`name_m`) at every zoom; exact, for pixels per metre double with each. */
function size(name: string, latDeg: number): ExpressionSpecification {
  const pxPerM = (zoom: number): number =>
    (TILE_PX * 2 ** zoom) / (CIRCUMFERENCE_M * Math.cos((latDeg * Math.PI) / 180))
  const at = (zoom: number): ExpressionSpecification => ['+', ['get', name], ['*', ['get', `${name}_m`], pxPerM(zoom)]]
  return ['interpolate', ['exponential', 2], ['zoom'], 0, at(0), DEEPEST, at(DEEPEST)]
}

const color: ExpressionSpecification = ['get', 'color']
const alpha: ExpressionSpecification = ['get', 'alpha']
const is = (type: string): ExpressionSpecification => ['==', ['geometry-type'], type]

type LookLayer = FillLayerSpecification | LineLayerSpecification | CircleLayerSpecification | SymbolLayerSpecification

export function lookLayers(id: string, latDeg = 0): LookLayer[] {
  const { ink, halo } = palette()
  return [
    {
      id: `${id}-fill`,
      type: 'fill',
      source: id,
      filter: is('Polygon'),
      paint: { 'fill-color': color, 'fill-opacity': ['*', alpha, ['get', 'fill']] },
    },
    {
      id: `${id}-line`,
      type: 'line',
      source: id,
      layout: { 'line-join': 'round' },
      paint: { 'line-color': color, 'line-opacity': alpha, 'line-width': size('width', latDeg) },
    },
    {
      id: `${id}-point`,
      type: 'circle',
      source: id,
      filter: ['all', is('Point'), ['==', ['get', 'label'], '']],
      paint: { 'circle-color': color, 'circle-opacity': alpha, 'circle-radius': size('radius', latDeg) },
    },
    {
      id: `${id}-label`,
      type: 'symbol',
      source: id,
      filter: ['!=', ['get', 'label'], ''],
      layout: { 'icon-image': ['concat', `text:${ink}:${halo}:`, ['get', 'label']], 'icon-allow-overlap': true },
    },
  ]
}
