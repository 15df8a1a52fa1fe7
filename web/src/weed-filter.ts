import type { Weed } from './wire.ts'

export interface WeedFilter {
  weeds: boolean
  crop: boolean
  treated: boolean
  open: boolean
  confidence: number
  /** Seen at or after this time of the robot's clock. */
  sinceS: number | null
}

export function passes(weed: Weed, filter: WeedFilter): boolean {
  const [, cls, , , , confidence, , , , lastS, treatedS] = weed
  if (cls === 0 ? !filter.weeds : !filter.crop) return false
  if (treatedS !== null ? !filter.treated : !filter.open) return false
  return confidence >= filter.confidence && (filter.sinceS === null || lastS >= filter.sinceS)
}
