/** Feeds the map's sources from the store: each at its own pace, none faster than a person sees. */

import type { GeoJSONSource, Map as MapLibre } from 'maplibre-gl'
import type { App } from '../app.ts'
import { collection } from '../geojson.ts'
import type { Features } from '../geojson.ts'
import type { Vec2, Weed } from '../wire.ts'
import {
  densityFeatures,
  fieldFeatures,
  gridFeatures,
  pathFeatures,
  trajectoryFeatures,
  waypointFeatures,
  weedFeature,
} from './features.ts'
import type { SourceId } from './layers.ts'

const TAIL_POINTS = 200
const PIECES_EVERY_MS = 250
const FREEZE_EVERY_MS = 1000
const WEEDS_EVERY_MS = 500
const DENSITY_EVERY_MS = 3000
export const DENSITY_CELL_M = 1

/** The map that it feeds; `overlay` draws the end of the track. */
interface LiveMap {
  readonly map: MapLibre
  readonly overlay: { tail: Vec2[]; request(): void }
  setData(id: SourceId, data: Features): void
}

export class LiveData {
  private frozen = 0
  private frozenRevision = -1
  private reached = -1
  private pendingSet = new Map<number, Weed>()
  private pendingGone = new Set<number>()
  private frozenMs = 0
  private pathTimer = 0
  private weedsTimer = 0
  private densityTimer = 0

  constructor(
    private readonly view: LiveMap,
    private readonly app: App,
  ) {
    const { store } = app
    app.onField(() => this.drawField())
    store.on('path', () => this.queuePath())
    store.on('trajectory', () => this.drawTrajectory())
    store.on('state', () => this.drawGoals())
    store.on('weeds', ({ set, gone, all }) => (all ? this.resetWeeds() : this.queueWeeds(set, gone)))
  }

  private drawField(): void {
    const { field, projection } = this.app
    if (!field) return
    const { boundary, obstacles, rows } = fieldFeatures(field, projection)
    this.view.setData('boundary', boundary)
    this.view.setData('obstacles', obstacles)
    this.view.setData('rows', rows)
    const centre = field.rows[0]?.start_map_m ?? [0, 0]
    this.view.setData('grid-1', gridFeatures(projection, centre, 1, 120))
    this.view.setData('grid-10', gridFeatures(projection, centre, 10, 1000))
    this.reached = -1
    this.frozenRevision = -1
    this.drawPath()
    this.drawGoals()
    this.drawTrajectory()
    this.resetWeeds()
  }

  /** A long path comes in many pieces. */
  private queuePath(): void {
    this.pathTimer ||= window.setTimeout(() => {
      this.pathTimer = 0
      this.drawPath()
    }, PIECES_EVERY_MS)
  }

  private drawPath(): void {
    this.view.setData('path', pathFeatures(this.app.store.path, this.app.projection))
  }

  private drawGoals(): void {
    const { field, store, projection } = this.app
    const reached = store.state?.mission?.waypoints_reached ?? 0
    if (!field || reached === this.reached) return
    this.reached = reached
    this.view.setData('waypoints', waypointFeatures(field, projection, reached))
  }

  /** The source holds all but the last points; the overlay draws those, so that long tracks stay cheap. */
  private drawTrajectory(): void {
    const { trajectory } = this.app.store
    const last = trajectory.pieces[trajectory.pieces.length - 1] ?? []
    const nowMs = performance.now()
    const isLong = trajectory.length - this.frozen > TAIL_POINTS && nowMs - this.frozenMs > FREEZE_EVERY_MS
    if (trajectory.revision !== this.frozenRevision || isLong) {
      this.frozenMs = nowMs
      this.frozenRevision = trajectory.revision
      this.frozen = trajectory.length
      this.view.setData('trajectory', trajectoryFeatures(trajectory.pieces, this.app.projection))
    }
    const tail = Math.min(last.length, trajectory.length - this.frozen + 1)
    this.view.overlay.tail = last.slice(last.length - tail)
    this.view.overlay.request()
  }

  private resetWeeds(): void {
    this.pendingSet.clear()
    this.pendingGone.clear()
    const features = [...this.app.store.weeds.values()].map((weed) => weedFeature(weed, this.app.projection))
    this.view.setData('weeds', collection(features))
    this.queueDensity()
  }

  private queueWeeds(set: Weed[], gone: number[]): void {
    for (const weed of set) {
      this.pendingSet.set(weed.id, weed)
      this.pendingGone.delete(weed.id)
    }
    for (const id of gone) {
      this.pendingGone.add(id)
      this.pendingSet.delete(id)
    }
    this.weedsTimer ||= window.setTimeout(() => this.flushWeeds(), WEEDS_EVERY_MS)
    this.queueDensity()
  }

  private flushWeeds(): void {
    this.weedsTimer = 0
    const add = [...this.pendingSet.values()].map((weed) => weedFeature(weed, this.app.projection))
    const remove = [...this.pendingGone]
    this.pendingSet.clear()
    this.pendingGone.clear()
    if (add.length || remove.length) this.view.map.getSource<GeoJSONSource>('weeds')?.updateData({ add, remove })
  }

  private queueDensity(): void {
    this.densityTimer ||= window.setTimeout(() => {
      this.densityTimer = 0
      const { store, projection } = this.app
      this.view.setData('density', densityFeatures(store.weeds.values(), DENSITY_CELL_M, projection))
    }, DENSITY_EVERY_MS)
  }
}
