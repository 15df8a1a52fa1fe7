/** The shapes that displays are made of; each carries its own look, so that one set of map layers draws them all. */

import type { Feature, Position } from 'geojson'
import type { Projection } from '../geo.ts'
import { placeOutline } from '../geo.ts'
import type { Vec2 } from '../wire.ts'

/** Sizes in pixels, or in metres with `_m`; `fill` is the share of `alpha` inside an outline. */
export interface Look {
  color?: string
  width?: number
  width_m?: number
  radius?: number
  radius_m?: number
  alpha?: number
  fill?: number
  label?: string
}

function properties(look: Look): Record<string, unknown> {
  return {
    color: '#b1128a',
    width: look.width_m ? 0 : 2,
    width_m: 0,
    radius: look.radius_m ? 0 : 5,
    radius_m: 0,
    alpha: 1,
    fill: 1,
    label: '',
    ...look,
  }
}

export class Drawing {
  readonly features: Feature[] = []

  constructor(private readonly projection: Projection) {}

  private add(geometry: Feature['geometry'], look: Look): void {
    this.features.push({ type: 'Feature', properties: properties(look), geometry })
  }

  private at(points: Vec2[]): Position[] {
    return points.map(([x, y]) => this.projection.toLonLat(x, y))
  }

  point(p: Vec2, look: Look): void {
    this.add({ type: 'Point', coordinates: this.projection.toLonLat(...p) }, look)
  }

  line(points: Vec2[], look: Look): void {
    if (points.length > 1) this.add({ type: 'LineString', coordinates: this.at(points) }, look)
  }

  polygon(points: Vec2[], look: Look): void {
    if (points.length > 2)
      this.add({ type: 'Polygon', coordinates: [this.at([...points, points[0]])] }, { width: 1, ...look })
  }

  /** A feature of somebody else's, in longitude and latitude. */
  foreign({ geometry, properties: own }: Feature, look: Look): void {
    if (geometry)
      this.features.push({ type: 'Feature', properties: { ...properties({ fill: 0.3, ...look }), ...own }, geometry })
  }

  label(p: Vec2, text: string, look: Look = {}): void {
    this.add({ type: 'Point', coordinates: this.projection.toLonLat(...p) }, { ...look, radius: 0, label: text })
  }

  /** A flat arrow from `p` along `yaw`. */
  arrow([x, y]: Vec2, yaw: number, lengthM: number, look: Look): void {
    const w = lengthM * 0.12
    const head = lengthM * 0.35
    this.polygon(
      placeOutline(
        [
          [0, w],
          [lengthM - head, w],
          [lengthM - head, 2.6 * w],
          [lengthM, 0],
          [lengthM - head, -2.6 * w],
          [lengthM - head, -w],
          [0, -w],
        ],
        x,
        y,
        yaw,
      ),
      look,
    )
  }

  /** The ellipse of a covariance (x, y; m²) that holds the robot with the probability of `sigmas`. */
  ellipse(centre: Vec2, [xx, xy, yy]: [number, number, number], sigmas: number, look: Look): void {
    const mean = (xx + yy) / 2
    const spread = Math.hypot((xx - yy) / 2, xy)
    const [a, b] = [mean + spread, mean - spread].map((value) => sigmas * Math.sqrt(Math.max(0, value)))
    const turn = Math.atan2(2 * xy, xx - yy) / 2
    const ring = Array.from(
      { length: 36 },
      (_, i): Vec2 => [a * Math.cos((i * Math.PI) / 18), b * Math.sin((i * Math.PI) / 18)],
    )
    this.polygon(placeOutline(ring, ...centre, turn), look)
  }
}
