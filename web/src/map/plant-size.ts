/** Sizes on the map that differ by the kind of plant. */

import type { ExpressionSpecification } from 'maplibre-gl'

export type ByZoom = ['interpolate', ['exponential', number], ['zoom'], ...number[]]

/** The sizes of weeds by zoom, with other ones for crops: `zoom` may stand only on the outside. */
export function byPlant([name, curve, zoom, ...stops]: ByZoom, crops: number[]): ExpressionSpecification {
  const sizes = stops.map((stop, i) => (i % 2 ? ['match', ['get', 'plant'], 0, stop, crops[(i - 1) / 2]] : stop))
  return [name, curve, zoom, ...sizes] as ExpressionSpecification
}
