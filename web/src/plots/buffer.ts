/** The last ten minutes of every numeric signal, in columns, dropped oldest first. */

export const KEEP_S = 600

export class SignalBuffer {
  names: string[]
  units: string[]
  private times: number[] = []
  private columns: (number | null)[][] = []

  constructor(names: string[], units: string[]) {
    this.names = names
    this.units = units
    this.clear()
  }

  clear(): void {
    this.times = []
    this.columns = this.names.map(() => [])
  }

  /** Other signals than before: start afresh. The same ones (a reconnect): keep the history. */
  rename(names: string[], units: string[]): void {
    if (names.join() === this.names.join()) return
    this.names = names
    this.units = units
    this.clear()
  }

  /** Samples [t_s, value of each signal]; false when none of them could be taken. */
  extend(samples: (number | null)[][]): boolean {
    let taken = 0
    for (const sample of samples) {
      const t = sample[0]
      if (t === null || sample.length !== this.names.length + 1) continue
      const last = this.times[this.times.length - 1]
      if (t < last)
        this.clear() // a new run, or a jump back in a replay
      else if (t === last) continue
      this.times.push(t)
      for (let i = 0; i < this.columns.length; i++) this.columns[i].push(sample[i + 1])
      taken++
    }
    this.forget()
    return taken > 0
  }

  private forget(): void {
    const n = this.times.length
    if (n < 1000 || this.times[n - 1] - this.times[0] < KEEP_S * 1.1) return
    const from = this.firstAfter(this.times[n - 1] - KEEP_S)
    this.times = this.times.slice(from)
    this.columns = this.columns.map((column) => column.slice(from))
  }

  private firstAfter(t: number): number {
    let low = 0
    let high = this.times.length
    while (low < high) {
      const mid = (low + high) >> 1
      if (this.times[mid] < t) low = mid + 1
      else high = mid
    }
    return low
  }

  get length(): number {
    return this.times.length
  }

  get lastS(): number | null {
    return this.times.length ? this.times[this.times.length - 1] : null
  }

  /** Columns [t, chosen signals…] over the last `windowS` before `endS`. */
  window(chosen: number[], windowS: number, endS: number | null = this.lastS): (number | null)[][] {
    if (endS === null) return [[], ...chosen.map(() => [])]
    const from = this.firstAfter(endS - windowS)
    const to = this.firstAfter(endS + 1e-9)
    return [this.times.slice(from, to), ...chosen.map((i) => (this.columns[i] ?? []).slice(from, to))]
  }
}

/** The columns as a CSV file with a header row. */
export function toCsv(header: string[], columns: (number | null)[][]): string {
  const quote = (name: string): string => (/[",\n]/.test(name) ? `"${name.replace(/"/g, '""')}"` : name)
  const rows = [header.map(quote).join(',')]
  for (let i = 0; i < columns[0].length; i++) rows.push(columns.map((c) => c[i] ?? '').join(','))
  return rows.join('\n') + '\n'
}

/** All values with some room; a signal that stands still lies in the middle. */
export function valueRange(_: unknown, low: number | null, high: number | null): [number, number] {
  if (low === null || high === null) return [-1, 1]
  const room = high - low > 1e-6 ? 0.08 * (high - low) : Math.max(0.1, 0.1 * Math.abs(high))
  return [low - room, high + room]
}
