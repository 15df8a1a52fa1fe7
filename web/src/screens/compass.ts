/** What a turn shows of the compass: the directions it has seen, and its error in each of them. */

import { setAttr, svg } from '../dom.ts'
import { fixed } from '../format.ts'
import type { Sample } from '../wire.ts'
import { say } from '../say.ts'

const SIZE = 100
const RADII = [30, 46] as const
const PLOT = { width: 340, height: 180, left: 44, right: 8, top: 26, bottom: 22 }

/** One wedge for each direction, counter-clockwise from the robot's nose at the top. */
export class CoverageRing {
  private readonly number = svg('text', { x: SIZE / 2, y: SIZE / 2 })
  private readonly total = svg('text', { x: SIZE / 2, y: SIZE / 2 + 14, 'font-size': 11 })
  readonly node = svg(
    'svg',
    { class: 'coverage-ring', viewBox: `0 0 ${SIZE} ${SIZE}`, role: 'img' },
    this.number,
    this.total,
  )
  private wedges: SVGPathElement[] = []

  show(seen: boolean[] | null): void {
    if (!seen) return
    if (this.wedges.length !== seen.length) {
      for (const wedge of this.wedges) wedge.remove()
      this.wedges = seen.map((_, index) => svg('path', { d: wedge(index, seen.length) }))
      this.node.append(...this.wedges)
    }
    this.wedges.forEach((wedge, index) => wedge.classList.toggle('seen', seen[index]))
    const count = seen.filter(Boolean).length
    setAttr(this.node, 'aria-label', say('directionsSeen', { count, all: seen.length }))
    this.number.textContent = String(count)
    this.total.textContent = say('ofAll', { all: seen.length })
  }
}

function wedge(index: number, total: number): string {
  const point = (radius: number, turn: number): string => {
    const angle = (turn / total) * 2 * Math.PI
    return `${(SIZE / 2 - radius * Math.sin(angle)).toFixed(2)} ${(SIZE / 2 - radius * Math.cos(angle)).toFixed(2)}`
  }
  const [inner, outer] = RADII
  const [start, end] = [point(inner, index), point(inner, index + 1)]
  const outwards = `M${start}L${point(outer, index)}A${outer} ${outer} 0 0 0 ${point(outer, index + 1)}`
  return `${outwards}L${end}A${inner} ${inner} 0 0 1 ${start}Z`
}

/** Mean error of the heading over the directions, degrees. */
export function errorPlot(before: Sample, after: Sample): SVGSVGElement {
  const { width, height, left, right, top, bottom } = PLOT
  const most = Math.max(largest(before), largest(after), 0.1)
  const x = (index: number): number => left + ((index + 0.5) / before.length) * (width - left - right)
  const y = (deg: number): number => top + (0.5 - deg / most / 2) * (height - top - bottom)
  const line = (values: Sample, name: string): SVGPolylineElement => {
    const points = values.flatMap((deg, index) => (deg === null ? [] : [`${x(index).toFixed(1)},${y(deg).toFixed(1)}`]))
    return svg('polyline', { class: name, points: points.join(' ') })
  }
  const [worst, worstNow] = [fixed(largest(before), 1), fixed(largest(after), 1)]
  const label = say('headingErrors', { before: worst, now: worstNow })
  const ticks = [most, 0, -most].flatMap((deg) => [
    svg('line', { class: 'axis', x1: left, x2: width - right, y1: y(deg), y2: y(deg) }),
    svg('text', { x: left / 2, y: y(deg) + 4 }, `${fixed(deg, 1)}°`),
  ])
  return svg(
    'svg',
    { class: 'error-plot', viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': label },
    ...ticks,
    line(before, 'before'),
    line(after, 'after'),
    svg('text', { x: width / 2, y: 14 }, say('headingErrorTitle')),
    svg('text', { x: left, y: height - 6 }, '0°'),
    svg('text', { x: width - 20, y: height - 6 }, '360°'),
  )
}

function largest(values: Sample): number {
  return Math.max(0, ...values.map((deg) => Math.abs(deg ?? 0)))
}
