/** Loads the map's code when a screen first needs it. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import type { MapView } from './view.ts'
import { say } from '../say.ts'

let made: MapView | null = null

/** The page's map inside `host`, or null, with a sentence about it, where it cannot be drawn. */
export async function openMap(host: HTMLElement, app: App): Promise<MapView | null> {
  if (app.off.has('map')) {
    host.append(el('p', { class: 'empty' }, say('mapIsOff')))
    return null
  }
  try {
    if (!made) {
      const { MapView } = await import('./view.ts')
      made = new MapView(app)
    }
  } catch {
    host.append(el('p', { class: 'empty' }, say('noWebGlForMap')))
    return null
  }
  made.attach(host)
  return made
}
