/** GeoJSON as the sources of the map take it. */

import type { Feature, FeatureCollection, Geometry } from 'geojson'

/** The accuracy of a GeoJSON source comes from its deepest tile: 18 would round to 11 mm, 22 to 0.7 mm. */
export const SOURCE_MAXZOOM = 22

export type Features = FeatureCollection<Geometry>

export function collection(features: Feature[]): Features {
  return { type: 'FeatureCollection', features }
}

export const EMPTY: Features = collection([])
