/** The map as its displays see it: what they lie on, and the layer list that they are entries of. */

import type { Map as MapLibre } from 'maplibre-gl'
import type { App } from '../app.ts'

/** Some kinds of display are one of the map's tools. */
export type ToolId = 'pan' | 'measure' | 'coordinates' | 'goal' | 'pose' | 'point' | 'polygon' | 'route'

/** The share of its opacity that a display has whose source has stopped. */
export const FADED = 0.35

/** An entry of the layer list; `layers` from bottom to top. */
export interface LayerGroup {
  id: string
  title: string
  layers: string[]
  visible: boolean
  opacity: number
  /** Shown paler than its opacity says: nothing sends what it draws any more. */
  readonly isFaded?: boolean
}

export interface DisplayHost {
  readonly app: App
  readonly map: MapLibre
  readonly node: HTMLElement
  readonly overlay: { request(): void }
  /** From top to bottom. */
  readonly groups: readonly LayerGroup[]
  addGroup(group: LayerGroup): void
  removeGroup(group: LayerGroup): void
  moveGroup(group: LayerGroup, to: number): void
  applyGroup(group: LayerGroup): void
  /** To be called when a display has other trouble than before. */
  onConditions(): void
  /** To be called when a group has got its layers later than it was added. */
  adopt(group: LayerGroup): void
  /** The layer that a picture of this group has to lie below. */
  layerAbove(group: LayerGroup): string | undefined
}
