/** Map frame (east, north metres at the datum) to and from longitude, latitude; WGS-84 radii at the datum. */

import type { Vec2 } from './wire.ts'

const WGS84_A_M = 6378137
const WGS84_E2 = 6.69437999014e-3
export const RAD = Math.PI / 180

export class Projection {
  readonly lonDeg: number
  readonly latDeg: number
  private readonly mPerDegLon: number
  private readonly mPerDegLat: number

  constructor(datum: { lat_deg: number; lon_deg: number }) {
    this.lonDeg = datum.lon_deg
    this.latDeg = datum.lat_deg
    const sin = Math.sin(datum.lat_deg * RAD)
    const w2 = 1 - WGS84_E2 * sin * sin
    const primeVerticalM = WGS84_A_M / Math.sqrt(w2)
    const meridianM = (WGS84_A_M * (1 - WGS84_E2)) / (w2 * Math.sqrt(w2))
    this.mPerDegLon = primeVerticalM * Math.cos(datum.lat_deg * RAD) * RAD
    this.mPerDegLat = meridianM * RAD
  }

  toLonLat(eastM: number, northM: number): Vec2 {
    return [this.lonDeg + eastM / this.mPerDegLon, this.latDeg + northM / this.mPerDegLat]
  }

  toMap(lonDeg: number, latDeg: number): Vec2 {
    return [(lonDeg - this.lonDeg) * this.mPerDegLon, (latDeg - this.latDeg) * this.mPerDegLat]
  }
}

export function distanceM(a: Vec2, b: Vec2): number {
  return Math.hypot(b[0] - a[0], b[1] - a[1])
}

export function lengthM(points: Vec2[]): number {
  let total = 0
  for (let i = 1; i < points.length; i++) total += distanceM(points[i - 1], points[i])
  return total
}

/** Area inside a ring, whichever way round it runs and whether or not its first point is repeated. */
export function areaM2(ring: Vec2[]): number {
  let twice = 0
  for (let i = 0; i < ring.length; i++) {
    const [x0, y0] = ring[i]
    const [x1, y1] = ring[(i + 1) % ring.length]
    twice += x0 * y1 - x1 * y0
  }
  return Math.abs(twice) / 2
}

/** A body-frame outline (x forward, y left) placed at a pose. */
export function placeOutline(outline: Vec2[], x: number, y: number, yaw: number): Vec2[] {
  const c = Math.cos(yaw)
  const s = Math.sin(yaw)
  return outline.map(([bx, by]) => [x + c * bx - s * by, y + s * bx + c * by])
}

/** Heading as a farmer says it: degrees clockwise from north. */
export function compassDeg(yaw: number): number {
  return (((90 - yaw / RAD) % 360) + 360) % 360
}

/** Whole degrees; 359.6 is north again, 0. */
export function compassText(yaw: number): string {
  return `${Math.round(compassDeg(yaw)) % 360}°`
}
