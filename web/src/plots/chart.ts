/** One uPlot chart that fills its box and takes the theme's colours. */

import uPlot from 'uplot'
import 'uplot/dist/uPlot.min.css'
import { el } from '../dom.ts'
import { plain } from '../say.ts'
import { colour, onTheme } from '../shell/theme.ts'
import type { SignalBuffer } from './buffer.ts'
import { valueRange } from './buffer.ts'

export class Chart {
  private readonly box: HTMLElement
  private readonly plotBox = el('div', { class: 'chart-box' })
  private plot: uPlot | null = null
  private readonly resize: ResizeObserver
  private readonly undoTheme: () => void

  constructor(
    host: HTMLElement,
    unit: string,
    private readonly indices: number[],
    private readonly labels: string[],
    private readonly sync: uPlot.Cursor.Sync,
  ) {
    this.box = el(
      'figure',
      { class: 'card chart' },
      el(
        'figcaption',
        {},
        ...labels.map((label, i) => el('span', { class: `series series-${indices[i] % 6}` }, label)),
        el('span', { class: 'muted' }, unit),
      ),
      this.plotBox,
    )
    host.append(this.box)
    this.build()
    this.resize = new ResizeObserver(() => this.fit())
    this.resize.observe(this.plotBox)
    this.undoTheme = onTheme(() => this.build())
  }

  private build(): void {
    this.plot?.destroy()
    const axis = {
      stroke: colour('muted'),
      grid: { stroke: colour('plot-grid'), width: 1 },
      ticks: { stroke: colour('plot-grid') },
      font: '12px system-ui, sans-serif',
    }
    const series = this.labels.map(
      (label, i): uPlot.Series => ({
        label,
        stroke: colour(`series-${this.indices[i] % 6}`),
        width: 2,
        points: { show: false },
      }),
    )
    this.plot = new uPlot(
      {
        width: Math.max(100, this.plotBox.clientWidth),
        height: Math.max(80, this.plotBox.clientHeight),
        legend: { show: false },
        scales: { x: { time: false }, y: { range: valueRange } },
        cursor: { sync: this.sync },
        axes: [
          { ...axis, values: (_, ticks) => ticks.map((t) => `${plain(t)} s`) },
          { ...axis, size: 56, values: (_, ticks) => ticks.map(plain) },
        ],
        series: [{}, ...series],
        hooks: { setCursor: [(plot) => this.showCursor(plot)] },
      },
      [[], ...this.labels.map(() => [])],
      this.plotBox,
    )
  }

  private fit(): void {
    const { clientWidth: width, clientHeight: height } = this.plotBox
    if (width > 0 && height > 0) this.plot?.setSize({ width, height })
  }

  private showCursor(plot: uPlot): void {
    const at = plot.cursor.idx
    this.box.querySelectorAll('.series').forEach((node, i) => {
      const value = at === null || at === undefined ? null : plot.data[i + 1]?.[at]
      node.textContent = typeof value === 'number' ? `${this.labels[i]} ${value.toPrecision(4)}` : this.labels[i]
    })
  }

  draw(signals: SignalBuffer, windowS: number, endS: number | null): void {
    const data = signals.window(this.indices, windowS, endS ?? signals.lastS)
    this.plot?.setData(data as uPlot.AlignedData)
  }

  close(): void {
    this.resize.disconnect()
    this.undoTheme()
    this.plot?.destroy()
    this.box.remove()
  }
}
