import type { Weed } from './wire.ts'

export interface WeedFilter {
  weeds: boolean
  crop: boolean
  treated: boolean
  open: boolean
  confidence: number
  /** Seen at most this time ago. */
  withinS: number | null
}

/** The time of the robot's clock from which on a plant must have been seen; null where any will do. */
export function sinceS({ withinS }: WeedFilter, nowS: number): number | null {
  return withinS === null ? null : nowS - withinS
}

export function passes(weed: Weed, filter: WeedFilter, nowS: number): boolean {
  if (weed.plant === 0 ? !filter.weeds : !filter.crop) return false
  if (weed.treated_s !== null ? !filter.treated : !filter.open) return false
  return weed.confidence >= filter.confidence && weed.last_seen_s >= (sinceS(filter, nowS) ?? -Infinity)
}
