/** Numbers as an operator reads them. */

import { decimals, findName, say } from './say.ts'

export const NONE = '–'

export function fixed(value: number | null | undefined, digits: number, unit = ''): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE
  const text = decimals(value, digits)
  return unit ? `${text} ${unit}` : text
}

export function metres(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE
  if (value < 0.995) return `${decimals(value * 100, value < 0.0995 ? 1 : 0)} cm`
  if (value < 1000) return `${decimals(value, value < 100 ? 1 : 0)} m`
  return `${decimals(value / 1000, 2)} km`
}

/** A number that keeps its unit where the line is broken. */
export function glue(text: string): string {
  return text.replaceAll(' ', '\u00a0')
}

export function duration(seconds: number | null | undefined): string {
  if (seconds === null || seconds === undefined || !Number.isFinite(seconds)) return NONE
  const s = Math.max(0, Math.round(seconds))
  const h = Math.floor(s / 3600)
  const m = Math.floor((s % 3600) / 60)
  const two = (n: number): string => String(n).padStart(2, '0')
  return h ? `${h}:${two(m)}:${two(s % 60)}` : `${m}:${two(s % 60)}`
}

export function bytes(value: number | null | undefined): string {
  if (value === null || value === undefined) return NONE
  const units = ['B', 'kB', 'MB', 'GB', 'TB']
  let i = 0
  let v = value
  while (v >= 1000 && i < units.length - 1) {
    v /= 1000
    i++
  }
  return `${decimals(v, i === 0 || v >= 100 ? 0 : 1)} ${units[i]}`
}

export function area(m2: number | null | undefined): string {
  if (m2 === null || m2 === undefined || !Number.isFinite(m2)) return NONE
  if (m2 < 0.1) return `${decimals(m2 * 1e4, 0)} cm²`
  if (m2 < 10000) return `${decimals(m2, m2 < 100 ? 1 : 0)} m²`
  return `${decimals(m2 / 10000, 2)} ha`
}

/** As in the middle of a sentence; German nouns keep their capitals. */
export function uncapitalised(text: string): string {
  return text.charAt(0).toLowerCase() + text.slice(1)
}

/** What the robot calls by this name, or the name as words: snake_case or a.dotted.path. */
export function words(name: string): string {
  const text = findName(name) ?? name.replace(/[._]/g, ' ').trim()
  return text.charAt(0).toUpperCase() + text.slice(1)
}

const UNIT_SUFFIX = /_(mps2?|radps2?|rad|deg|hz|px|ratio|m|s|v|a)$/
const SIGNAL_NAMES: Record<string, string> = {
  v: say('speed'),
  v_commanded: say('speedCommanded'),
  pos_std: say('position'),
  yaw_std: say('headingStd'),
  protection: say('protectionLevel'),
}

export function bareName(name: string): string {
  return name.slice(name.lastIndexOf('.') + 1).replace(UNIT_SUFFIX, '')
}

/** A name of the robot's code without its unit, as words: `yaw_rate_radps` is 'Yaw rate'. */
export function quantity(name: string): string {
  const bare = bareName(name)
  return SIGNAL_NAMES[bare] ?? words(bare)
}

const FIX_NAMES: Record<string, string> = {
  '0': say('noFix'),
  '1': 'GNSS',
  '2': 'DGNSS',
  '3': 'GNSS',
  '4': 'RTK',
  '5': say('float'),
  none: say('noFix'),
  single: 'GNSS',
  dgps: 'DGNSS',
  sbas: 'DGNSS',
  float: say('float'),
  rtk_float: say('float'),
  fixed: 'RTK',
  rtk_fixed: 'RTK',
}

/** The receiver's quality (the number of NMEA GGA or a name) in words. */
export function fixName(quality: number | string): string {
  return FIX_NAMES[String(quality).toLowerCase()] ?? String(quality)
}
