/** The display of features in longitude and latitude. */

import type { Feature, FeatureCollection } from 'geojson'
import type { Drawing } from './drawing.ts'
import type { TextMessage } from './messages.ts'
import { amount, words } from './options.ts'
import type { Setting } from './setting.ts'

type GeoJson = FeatureCollection | Feature

/** The features of a program, or of a topic that has them as text; other text changes nothing. */
export function foldGeoJson(known: GeoJson | undefined, message: GeoJson | TextMessage): GeoJson | undefined {
  return 'data' in message ? (readText(message.data) ?? known) : message
}

function readText(text: string): GeoJson | undefined {
  try {
    const found = JSON.parse(text) as GeoJson | null
    return found?.type === 'Feature' || found?.type === 'FeatureCollection' ? found : undefined
  } catch {
    return undefined
  }
}

/** Each feature in the display's style, unless its own properties say another. */
export function drawGeoJson(data: GeoJson, draw: Drawing, { options }: Setting): void {
  const look = {
    color: words(options, 'color'),
    width: amount(options, 'width_px'),
    radius: amount(options, 'radius_px'),
    alpha: amount(options, 'opacity'),
  }
  for (const feature of 'features' in data ? data.features : [data]) draw.foreign(feature, look)
}
