/** Layers that a program adds from Python: GeoJSON, asked for again and again. */

import type { GeoJSONSource } from 'maplibre-gl'
import { api } from '../api.ts'
import type { Panel } from '../wire.ts'
import type { Features } from './features.ts'
import { EMPTY } from './features.ts'
import type { MapView } from './view.ts'

export async function addPanelLayers(view: MapView): Promise<void> {
  const found = await api.panels().catch((): Panel[] => [])
  for (const panel of found) if (panel.kind === 'layer') addPanelLayer(view, panel)
}

function addPanelLayer(view: MapView, panel: Panel): void {
  const { color = '#b1128a', width_px: width = 2, radius_px: radius = 5, opacity = 1 } = panel.style ?? {}
  const { id } = panel
  view.map.addSource(id, { type: 'geojson', data: EMPTY, maxzoom: 22 })
  view.map.addLayer({ id: `${id}-fill`, type: 'fill', source: id, filter: ['==', ['geometry-type'], 'Polygon'], paint: { 'fill-color': color, 'fill-opacity': opacity * 0.3 } })
  view.map.addLayer({ id: `${id}-line`, type: 'line', source: id, paint: { 'line-color': color, 'line-width': width, 'line-opacity': opacity } })
  view.map.addLayer({ id: `${id}-point`, type: 'circle', source: id, filter: ['==', ['geometry-type'], 'Point'], paint: { 'circle-color': color, 'circle-radius': radius, 'circle-opacity': opacity } })
  view.addGroup({ id, title: panel.title, layers: [`${id}-fill`, `${id}-line`, `${id}-point`], visible: true, opacity: 1 })
  const load = async (): Promise<void> => {
    const response = await api.panelData(id).catch(() => null)
    if (response) view.map.getSource<GeoJSONSource>(id)?.setData((await response.json()) as Features)
  }
  void load()
  setInterval(() => {
    if (view.node.isConnected && !document.hidden) void load()
  }, (panel.refresh_s ?? 1) * 1000)
}
