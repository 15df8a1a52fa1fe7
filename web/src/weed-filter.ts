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
  if (weed.plant === 0 ? !filter.weeds : !filter.crop) return false
  if (weed.treated_s !== null ? !filter.treated : !filter.open) return false
  return weed.confidence >= filter.confidence && (filter.sinceS === null || weed.last_seen_s >= filter.sinceS)
}
