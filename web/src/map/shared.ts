/** Loads the map's code when a screen first needs it. */

import type { App } from '../app.ts'
import { el } from '../dom.ts'
import type { MapView } from './view.ts'

let made: MapView | null = null

/** The page's map inside `host`, or null (and a word about it) where there is none. */
export async function openMap(host: HTMLElement, app: App): Promise<MapView | null> {
  if (app.off.has('map')) {
    host.append(el('p', { class: 'empty' }, 'The map is switched off by the address of this page.'))
    return null
  }
  try {
    if (!made) {
      const { MapView } = await import('./view.ts')
      made = new MapView(app)
    }
  } catch {
    host.append(
      el(
        'p',
        { class: 'empty' },
        'This browser cannot draw the map (it needs WebGL 2). Driving and STOP work without it.',
      ),
    )
    return null
  }
  made.attach(host)
  return made
}
